import bpy

settings = bpy.context.scene.strata.soft_shadow

settings.layers = 3
settings.resolution = 1024
settings.method = "bitmask"
settings.max_samples = 512
settings.refinements = 1
settings.gradient_scale = 1.0
settings.gradient_cap_m = 1000000000.0
settings.spacing = 1
settings.rays = 64
