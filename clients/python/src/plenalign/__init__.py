"""Client of Plenalign, the daemon that aligns underwater plenoptic cameras.

    import plenalign

    with plenalign.Client() as client, client.lease(note="first light") as lease:
        job = lease.start(plenalign.models.JointAlignmentJob()).wait()
        print(job.report)

Lengths carry their unit in the name; what is not known is none.
"""

from . import aio, configuration, errors, models
from ._following import CombinedSince, Message, Picture, Reading, SpacingMap
from .access import Access
from .address import Address
from .client import Client
from .errors import *  # noqa: F403
from .images import Image, Images
from .job import FINAL, GOOD, Job
from .lease import Lease
from .settings import Configuration, Settings
from .watch import Watch

__version__ = "0.1.0"

__all__ = [
    "FINAL",
    "GOOD",
    "Access",
    "Address",
    "Client",
    "CombinedSince",
    "Configuration",
    "Image",
    "Images",
    "Job",
    "Lease",
    "Message",
    "Picture",
    "Reading",
    "Settings",
    "SpacingMap",
    "Watch",
    "aio",
    "configuration",
    "errors",
    "models",
    *errors.__all__,
]
