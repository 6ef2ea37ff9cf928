"""The commands: ``rm3d NAME ...`` and ``python tools/NAME.py ...`` run ``main`` of the module of that name."""
