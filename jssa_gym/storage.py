"""Files that are complete or not there."""

import os
from pathlib import Path


def write_whole(path: Path, content: bytes) -> None:
    """Write a file under another name, flush it to the disk and rename it.

    Args:
        path: Of the file; it is replaced.
        content: All of it.

    Raises:
        OSError: It cannot be written; what was there is unchanged.
    """
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with unfinished.open("wb") as file:
            file.write(content)
            file.flush()
            # the name must not reach the disk before the content
            os.fsync(file.fileno())
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)
