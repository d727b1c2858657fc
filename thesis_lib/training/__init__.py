"""Training of policies: one run, a sweep of many, what they keep, and tests of it."""
