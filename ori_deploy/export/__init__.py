"""What a design leaves the house as: parts to print, sheets to cut, models for other programs."""
