"""Programming languages of generated code, one module each; `armid.codegen.catalogue` lists these modules."""
