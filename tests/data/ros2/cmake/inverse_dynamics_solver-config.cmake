# Stand-in for the package of inverse_dynamics_solver, which exports a target or, if WITHOUT_TARGET, folders of headers.
if(WITHOUT_TARGET)
  set(inverse_dynamics_solver_INCLUDE_DIRS ${CMAKE_CURRENT_LIST_DIR}/..)
else()
  add_library(inverse_dynamics_solver::headers INTERFACE IMPORTED)
  target_include_directories(inverse_dynamics_solver::headers INTERFACE ${CMAKE_CURRENT_LIST_DIR}/..)
  set(inverse_dynamics_solver_TARGETS inverse_dynamics_solver::headers)
endif()
