"""Where the runs of a sweep are kept: a directory, or any place that fsspec has a driver for."""

from __future__ import annotations

import hashlib
import tempfile
from pathlib import Path

import fsspec
from fsspec.implementations.local import LocalFileSystem

from thesis_lib.files import replacing, writable_directory
from thesis_lib.training.checkpoint import FILES


class Store:
    """A place for runs, each in a directory of its own name.

    Runs are trained and read in :attr:`folder`.  That is the place itself where it is on this
    machine's disks; otherwise it is a copy, and :meth:`pull` and :meth:`push` carry runs over.

    Parameters
    ----------
    place
        A path, or a URL such as ``s3://bucket/sweep``.

    Raises
    ------
    ValueError
        When the URL cannot be used, or the directory cannot be written to.
    """

    def __init__(self, place: Path | str) -> None:
        self.place = str(place)
        try:
            files, root = fsspec.url_to_fs(self.place)
        except (ImportError, ValueError) as error:
            cause = " ".join(str(error).split()).rstrip(".")
            raise ValueError(
                f"the store {self.place!r} cannot be used ({cause}): name a directory, or a URL "
                "whose fsspec driver is installed."
            ) from error
        self._files, self._root = files, root
        self._local = isinstance(files, LocalFileSystem)
        folder = Path(root)
        if not self._local:
            digest = hashlib.sha256(self.place.encode()).hexdigest()[:16]
            folder = Path(tempfile.gettempdir()) / f"thesis-store-{digest}"
        self.folder = writable_directory(folder)

    def names(self) -> list[str]:
        """Names of the runs that have a checkpoint, sorted."""
        found = self._files.glob(f"{self._root}/*/checkpoint.pt")
        return sorted(path.split("/")[-2] for path in found)

    def pull(self, name: str) -> None:
        """Take over from the place what it has of a run, and forget what it has not."""
        if self._local:
            return
        folder = self.folder / name
        for file in FILES:
            theirs = f"{self._root}/{name}/{file}"
            if not self._files.exists(theirs):
                (folder / file).unlink(missing_ok=True)
                continue
            folder.mkdir(exist_ok=True)
            with replacing(folder / file) as temporary:
                temporary.write_bytes(self._files.cat_file(theirs))

    def push(self, name: str) -> None:
        """Bring a run as it is now to the place, in the order in which it was written."""
        if self._local:
            return
        self._files.makedirs(f"{self._root}/{name}", exist_ok=True)
        for file in FILES:
            mine, theirs = self.folder / name / file, f"{self._root}/{name}/{file}"
            # Not every place writes a file at once, so it comes under another name first.
            self._files.pipe_file(f"{theirs}.part", mine.read_bytes())
            self._files.mv(f"{theirs}.part", theirs)
