"""A page on loopback that shows drives live, and lets a person steer them: adrl view."""
