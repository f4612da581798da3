"""Studies (robot, recordings and options of an identification) and the identification of the model of a study."""
