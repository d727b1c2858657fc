"""Chapters 1 and 6 and the summary: what they say of the other chapters' results.

Most of it repeats other chapters, and is judged by their claims (``rests_on`` in ``claims.toml``);
``targets`` holds the criteria of what only section 6.1 says.  ``questions.toml`` has the research
questions, the thesis's answers and ours.
"""
