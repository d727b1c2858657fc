"""What only the book needs: staged build and generated pages.

``thesis book`` calls :func:`thesis_lib.book.build.build`.  This file imports nothing on purpose:
the build finds out which pages depend on which modules by following imports, and a notebook must
not seem to depend on the builder.
"""
