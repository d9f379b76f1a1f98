"""Files that are there as a whole or not at all."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import TypeAlias
from uuid import uuid4

Path_: TypeAlias = "str | os.PathLike[str]"


def write(path: Path_, data: bytes) -> None:
    """Writes a file under another name beside its place, and puts it there once it is on the disk."""
    target = Path(path)
    beside = target.with_name(f".{target.name}.{uuid4().hex}")
    try:
        with open(beside, "xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(beside, target)
    except BaseException:
        with suppress(OSError):
            beside.unlink()
        raise
