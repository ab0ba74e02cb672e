"""Gazebo worlds (SDF), flattened to what a planar robot meets.

document: XML and numbers. library: where files are. models: the tree, with includes. frames: poses by name.
geometry, footprint, mesh: shapes and what they cover. bodies: models, and whether they stay. load: the world.
"""

from adrl.worlds.sdf.load import HEIGHT_BAND_M, MARGIN_M, SdfWorld, load_sdf

__all__ = ["HEIGHT_BAND_M", "MARGIN_M", "SdfWorld", "load_sdf"]
