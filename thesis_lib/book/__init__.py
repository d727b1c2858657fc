"""What only the book needs: notebook helpers, figure style, staged build and generated pages.

Notebooks import :mod:`thesis_lib.book.notebook`; ``thesis book`` calls
:func:`thesis_lib.book.build.build`.  This file imports nothing on purpose: the build finds out
which pages depend on which modules by following imports, and a notebook must not seem to depend
on the builder.
"""
