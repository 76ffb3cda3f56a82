"""Single servos at the bench: found, named, moved, calibrated, diagnosed. Nothing here knows of plans in motion."""
