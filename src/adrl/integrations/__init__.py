"""ADRL beside other programs. Each part is optional and imported by the commands that need it."""
