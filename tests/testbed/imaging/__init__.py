"""How the images of containers/ are built on this computer; `tests.testbed.images` is the door to it."""
