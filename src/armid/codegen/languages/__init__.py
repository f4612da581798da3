"""Languages of generated code, each in its own module; `armid.codegen.catalogue` lists them."""
