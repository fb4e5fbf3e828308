import bpy

settings = bpy.context.scene.strata.toon

settings.light = "facing"
settings.exposure = 1.0
settings.shadows = True
settings.shadow_edge = "crisp"
settings.normals = "smooth"
settings.mix = "multiply"
settings.emission = 1.0
settings.rim = 0.0
settings.rim_width = 0.3
settings.rim_color = [1.0, 1.0, 1.0]
settings.halftone = True
settings.halftone_repeat = 150.0
settings.halftone_scale = 1.0
settings.halftone_cutoff = 0.45
settings.halftone_angle = 0.7853981633974483
settings.halftone_opacity = 0.8
settings.halftone_fade_start_m = 1000000000.0
settings.halftone_fade_end_m = 1000000000.0
settings.halftone_anchor = "screen"
settings.halftone_cell_m = 0.05
settings.outline = True
settings.outline_unit = "pixel"
settings.outline_width_px = 2.0
settings.outline_width_m = 0.01
settings.outline_least_px = 0.0
settings.outline_most_px = 64.0
settings.outline_color = [0.0, 0.0, 0.0]
settings.outline_thickness = ""
settings.object_lines = False
settings.material_lines = False
settings.crease_angle = 3.141592653589793
settings.line_width_px = 1
