"""Languages of generated code, one module for each; `armid.codegen.catalogue` lists them."""
