"""Who calls, where no token says so."""

from __future__ import annotations

import getpass
import socket


def this_user() -> str:
    """User and machine; a stop asks, too, so that nothing that is wrong with a name may be in its way."""
    try:
        user = getpass.getuser()
    except (OSError, KeyError, ImportError):
        user = "somebody"
    name = f"{user}@{socket.gethostname() or 'this machine'} (Python)"
    return name.encode(errors="replace").decode()
