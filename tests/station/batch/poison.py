"""The work of a batch with a photograph that ends its process."""

import os
import signal

from station.batch.item import ItemRow, Job, work
from station.calibration.folder_photographs import Item


def poisoned(item: Item, job: Job) -> ItemRow:
    """The work of a batch, but a photograph called poison ends its process."""
    if item.paths[0].stem == "poison":
        os.kill(os.getpid(), signal.SIGKILL)
    return work(item, job)
