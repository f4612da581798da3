"""Modules of the controllers of `armid.export.load.catalogue.CONTROLLERS`, one for each vendor."""
