"""Made-up scenes in the native formats of real data sets; every one says that it is synthetic."""
