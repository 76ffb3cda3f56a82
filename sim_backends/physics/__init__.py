"""The physics plant: a structure as rigid panels on film hinges, in MuJoCo."""
