"""A folder as a ZIP that is made while it is read, so that it takes neither memory nor disk."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZIP_STORED

from zipstream import ZipStream

LEVEL = 5
"""Records shrink to about a tenth; more costs time that the services need."""

COMPRESSED = (".png", ".jpg", ".webp")
"""Suffixes of files that are stored without further compression."""


def archive(folder: Path) -> Iterator[bytes]:
    """The ZIP of a folder, under its name and without links.

    Raises OSError if the folder is removed meanwhile.
    """
    stream = ZipStream(compress_type=ZIP_DEFLATED, compress_level=LEVEL)
    for parent, folders, names in os.walk(folder, onerror=_raise):
        folders.sort()
        inside = Path(folder.name, Path(parent).relative_to(folder))
        stream.add_path(parent, str(inside), recurse=False)
        for name in sorted(names):
            path = Path(parent, name)
            if path.is_file() and not path.is_symlink():
                stored = path.suffix in COMPRESSED
                stream.add_path(
                    path, str(inside / name), recurse=False, compress_type=ZIP_STORED if stored else ZIP_DEFLATED
                )
    yield from stream


def _raise(error: OSError) -> None:
    raise error
