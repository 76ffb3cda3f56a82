"""A component on the vehicle's MAVLink network that deploys and folds the structure, and what talks to it."""
