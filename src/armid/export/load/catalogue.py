"""Catalogue `CONTROLLERS` of robot controllers that take load data: a new one needs a module and one line here."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from armid.lazy_catalogue import Catalogue

if TYPE_CHECKING:
    from armid.export.load.flange_load import FlangeLoad
    from armid.export.load.load_text import LoadText


class LoadFormat(Protocol):
    """Interface that the module of a controller has."""

    @staticmethod
    def write(load: FlangeLoad) -> LoadText:
        """Makes the files with the load data of a controller.

        Args:
            load: The load in the axes of the flange.

        Raises:
            OutputError: A number is outside the bounds that the vendor documents.
        """
        ...


CONTROLLERS: Catalogue[LoadFormat] = Catalogue(
    {
        "ur": "armid.export.load.controllers.ur",
        "franka": "armid.export.load.controllers.franka",
        "kuka": "armid.export.load.controllers.kuka",
        "abb": "armid.export.load.controllers.abb",
        "fanuc": "armid.export.load.controllers.fanuc",
        "xarm": "armid.export.load.controllers.xarm",
        "doosan": "armid.export.load.controllers.doosan",
    }
)
"""Modules of the controllers; the keys are the names that `armid payload --to` accepts."""
