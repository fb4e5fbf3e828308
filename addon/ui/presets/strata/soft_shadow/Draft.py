import bpy

settings = bpy.context.scene.strata.soft_shadow

settings.layers = 2
settings.resolution = 512
settings.method = "bitmask"
settings.max_samples = 128
settings.refinements = 1
settings.gradient_scale = 1.0
settings.gradient_cap_m = 1000000000.0
settings.spacing = 2
settings.rays = 64
