"""One object per procedure, from which command, batch, record, schema, page, limits and certificate follow.

A `Procedure` names itself, says what it takes (`Inputs`), has a model of `Settings`, and measures. The built-in ones
are in `station.procedure.builtin`; a package outside adds its own under the entry-point group `station.procedures`.
What lives here may import pages (`station.reports`) and what is below them.
"""

from station.procedure.base import Inputs, PhotographProcedure, PlaneSettings, Procedure, Settings, setting
from station.procedure.schema import procedure_named, procedure_names

__all__ = [
    "Inputs", "PhotographProcedure", "PlaneSettings", "Procedure", "Settings", "procedure_named", "procedure_names",
    "setting",
]  # fmt: skip
