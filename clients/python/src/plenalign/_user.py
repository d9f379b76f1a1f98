"""Who calls, where no token says so."""

from __future__ import annotations

import getpass
import socket


def this_user() -> str:
    """User and machine."""
    try:
        user = getpass.getuser()
    except (OSError, KeyError):
        user = "somebody"
    return f"{user}@{socket.gethostname() or 'this machine'} (Python)"
