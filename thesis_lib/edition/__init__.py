"""The edition's framework: what an experiment, a claim, a page and a figure of this book are."""
