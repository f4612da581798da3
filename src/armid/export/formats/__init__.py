"""Writers of robot descriptions, one module for each format; `armid.export.catalogue` lists them."""
