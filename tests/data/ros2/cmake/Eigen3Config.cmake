# Stand-in for the package of Eigen: the folder EIGEN_INCLUDE.
add_library(Eigen3::Eigen INTERFACE IMPORTED)
target_include_directories(Eigen3::Eigen SYSTEM INTERFACE ${EIGEN_INCLUDE})
