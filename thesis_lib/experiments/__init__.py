"""Experiments of the chapters that have not moved into :mod:`thesis_lib.edition`'s form yet."""
