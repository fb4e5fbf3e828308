"""Building blocks shared by the sample scenes: sessions, materials, meshes, scattering, lights and saving."""

import hashlib
import math
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

FOLDER = Path(__file__).resolve().parent


def new_scene(name, frames=(1, 1)):
    """Empty the session and set up one Cycles scene in metres at 960x540."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.name = name
    scene.unit_settings.system = "METRIC"
    scene.unit_settings.scale_length = 1.0
    scene.frame_start, scene.frame_end = frames
    scene.frame_set(frames[0])
    render = scene.render
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = 960, 540, 100
    render.fps = 24
    render.filepath = "//"
    scene.cycles.samples = 64
    scene.cycles.use_denoising = True
    scene.cycles.max_bounces = 4
    scene.view_settings.view_transform = "AgX"
    return scene


def collection(name, parent=None, linked=True):
    """Make a collection; one that is not linked is drawn only through its instances."""
    made = bpy.data.collections.new(name)
    if linked:
        (parent or bpy.context.scene.collection).children.link(made)
    return made


def add_object(name, data, into=None, location=(0, 0, 0), rotation=(0, 0, 0), scale=(1, 1, 1)):
    """Link a new object; rotation is in degrees, scale a number or three."""
    made = bpy.data.objects.new(name, data)
    made.location = location
    made.rotation_euler = [math.radians(angle) for angle in rotation]
    made.scale = (scale,) * 3 if isinstance(scale, int | float) else scale
    (into or bpy.context.scene.collection).objects.link(made)
    return made


def instance(name, source, into=None, **placement):
    """An empty that draws the collection `source`."""
    made = add_object(name, None, into, **placement)
    made.instance_type = "COLLECTION"
    made.instance_collection = source
    made.empty_display_size = 0.2
    return made


def image(name, pixels):
    """A packed 8-bit image from an array of rows (the bottom one first) of RGBA in 0..1."""
    height, width, _ = pixels.shape
    made = bpy.data.images.new(name, width, height, alpha=True)
    made.pixels.foreach_set(np.ascontiguousarray(pixels, dtype=np.float32).ravel())
    made.update()
    made.pack()
    return made


def material(name, color, roughness=0.8, picture=None, cut_out=False):
    """A Principled BSDF; `picture` replaces the base colour, and its alpha cuts holes with `cut_out`."""
    made = bpy.data.materials.new(name)
    made.diffuse_color = (*color, 1.0)
    tree = made.node_tree
    shader = tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*color, 1.0)
    shader.inputs["Roughness"].default_value = roughness
    shader.inputs["Specular IOR Level"].default_value = 0.25
    if picture:
        texture = tree.nodes.new("ShaderNodeTexImage")
        texture.location = (-320, 200)
        texture.image = picture
        texture.interpolation = "Closest" if cut_out else "Linear"
        tree.links.new(texture.outputs["Color"], shader.inputs["Base Color"])
        if cut_out:
            tree.links.new(texture.outputs["Alpha"], shader.inputs["Alpha"])
    return made


def mesh(name, vertices, faces, surface=None, smooth=False):
    """A mesh from lists of vertices and faces."""
    made = bpy.data.meshes.new(name)
    made.from_pydata([tuple(map(float, v)) for v in vertices], [], [tuple(map(int, f)) for f in faces])
    if surface:
        made.materials.append(surface)
    made.polygons.foreach_set("use_smooth", np.full(len(made.polygons), smooth))
    made.update()
    return made


def project_uv(made, scale=0.25):
    """Box-projected texture coordinates: a metre is `scale` of the picture."""
    layer = made.uv_layers.new(name="UVMap")
    for polygon in made.polygons:
        axis = int(np.argmax(np.abs(polygon.normal)))
        first, second = [(1, 2), (0, 2), (0, 1)][axis]
        for loop in polygon.loop_indices:
            place = made.vertices[made.loops[loop].vertex_index].co
            layer.data[loop].uv = (place[first] * scale, place[second] * scale)
    return made


BOX_FACES = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]


def boxes(name, spans, surface=None):
    """One mesh of axis-aligned boxes, each given by its two corners."""
    vertices, faces = [], []
    for low, high in spans:
        start = len(vertices)
        ends = list(zip(low, high, strict=True))
        vertices += [(x, y, z) for z in ends[2] for y in ends[1] for x in ends[0]]
        faces += [[start + corner for corner in face] for face in BOX_FACES]
    return mesh(name, vertices, faces, surface)


def tubes(name, runs, surface=None, sides=8, smooth=True):
    """Round bars from point to point: `runs` holds (start, end, start radius, end radius)."""
    vertices, faces = [], []
    turns = np.linspace(0, 2 * math.pi, sides, endpoint=False)
    for begin, end, thick, thin in runs:
        begin, end = np.asarray(begin, float), np.asarray(end, float)
        along = (end - begin) / np.linalg.norm(end - begin)
        aside = np.cross(along, (0, 0, 1) if abs(along[2]) < 0.9 else (1, 0, 0))
        aside /= np.linalg.norm(aside)
        up = np.cross(along, aside)
        ring = np.outer(np.cos(turns), aside) + np.outer(np.sin(turns), up)
        start = len(vertices)
        vertices += [*(begin + thick * ring), *(end + thin * ring)]
        for side in range(sides):
            after = (side + 1) % sides
            faces.append((start + side, start + after, start + sides + after, start + sides + side))
    return mesh(name, vertices, faces, surface, smooth)


def lathe(name, profile, surface, into=None, steps=48, **placement):
    """A turned object: `profile` lists (radius, height) from the bottom up."""
    shape = bpy.data.meshes.new(name)
    shape.from_pydata([(r, 0, z) for r, z in profile], [(i, i + 1) for i in range(len(profile) - 1)], [])
    shape.materials.append(surface)
    made = add_object(name, shape, into, **placement)
    screw = made.modifiers.new("Turn", "SCREW")
    screw.steps = screw.render_steps = steps
    screw.use_merge_vertices = True
    screw.merge_threshold = 1e-4
    screw.use_normal_calculate = True
    screw.use_smooth_shade = True
    made.modifiers.new("Crisp", "EDGE_SPLIT").split_angle = math.radians(32)
    return made


def subdivide(made, levels):
    """Subdivision surface with the same level in the viewport and in the render."""
    modifier = made.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels = modifier.render_levels = levels
    return made


def array(made, count, offset):
    """Repeat an object `count` times at a constant offset."""
    modifier = made.modifiers.new("Array", "ARRAY")
    modifier.count = count
    modifier.use_relative_offset = False
    modifier.use_constant_offset = True
    modifier.constant_offset_displace = offset
    return made


def bevel(made, width, segments=1):
    """Round the edges a little."""
    modifier = made.modifiers.new("Bevel", "BEVEL")
    modifier.width, modifier.segments = width, segments
    return made


def curve(name, points, radius, surface, into=None, cyclic=False, **placement):
    """A smooth round rope or rod through `points`."""
    shape = bpy.data.curves.new(name, "CURVE")
    shape.dimensions = "3D"
    shape.resolution_u = 6
    shape.bevel_depth, shape.bevel_resolution = radius, 2
    shape.use_fill_caps = True
    spline = shape.splines.new("NURBS")
    spline.points.add(len(points) - 1)
    spline.points.foreach_set(
        "co", np.append(np.asarray(points, float), np.ones((len(points), 1)), 1).ravel()
    )
    spline.order_u, spline.use_endpoint_u, spline.use_cyclic_u = 4, not cyclic, cyclic
    shape.materials.append(surface)
    return add_object(name, shape, into, **placement)


def _scatter_tree(name, source, settings):
    """Geometry nodes that put random members of a collection on the faces or vertices of a mesh."""
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    nodes, link = tree.nodes, tree.links.new
    entry, exit_ = nodes.new("NodeGroupInput"), nodes.new("NodeGroupOutput")
    members = nodes.new("GeometryNodeCollectionInfo")
    members.inputs["Collection"].default_value = source
    members.inputs["Separate Children"].default_value = True
    members.inputs["Reset Children"].default_value = True
    place = nodes.new("GeometryNodeInstanceOnPoints")
    place.inputs["Pick Instance"].default_value = True
    turn = nodes.new("GeometryNodeRotateInstances")
    turn.inputs["Local Space"].default_value = True

    def random(kind, low, high, seed):
        node = nodes.new("FunctionNodeRandomValue")
        node.data_type = kind
        live = {socket.name: socket for socket in node.inputs if socket.enabled}
        live["Min"].default_value, live["Max"].default_value = low, high
        live["Seed"].default_value = seed
        return next(socket for socket in node.outputs if socket.enabled)

    seed = settings["seed"]
    if settings["density"]:
        points = nodes.new("GeometryNodeDistributePointsOnFaces")
        points.inputs["Density"].default_value = settings["density"]
        points.inputs["Seed"].default_value = seed
        link(entry.outputs[0], points.inputs["Mesh"])
        link(points.outputs["Points"], place.inputs["Points"])
        link(points.outputs["Rotation"], place.inputs["Rotation"])
    else:
        link(entry.outputs[0], place.inputs["Points"])
    tilt, spin = (math.radians(settings[key]) for key in ("tilt", "spin"))
    link(random("FLOAT_VECTOR", (-tilt, -tilt, -spin), (tilt, tilt, spin), seed + 1), turn.inputs["Rotation"])
    link(random("FLOAT", *settings["scale"], seed + 2), place.inputs["Scale"])
    link(random("INT", 0, len(source.objects) - 1, seed + 3), place.inputs["Instance Index"])
    link(members.outputs["Instances"], place.inputs["Instance"])
    link(place.outputs["Instances"], turn.inputs["Instances"])
    link(turn.outputs["Instances"], exit_.inputs[0])
    return tree


def scatter(target, source, density=None, seed=1, scale=(0.8, 1.2), tilt=20, spin=180):
    """Replace `target` by instances: `density` a square metre, or one on each vertex when it is None."""
    settings = {"density": density, "seed": seed, "scale": scale, "tilt": tilt, "spin": spin}
    modifier = target.modifiers.new("Scatter", "NODES")
    modifier.node_group = _scatter_tree(f"Scatter {target.name}", source, settings)
    return target


def aim(made, target):
    """Turn a camera or a lamp towards a point."""
    made.rotation_euler = (Vector(target) - made.location).to_track_quat("-Z", "Y").to_euler()
    return made


def lamp(name, kind, location, target, energy, color=(1, 1, 1), into=None, **settings):
    """A light of `kind` that looks at `target`; the other settings go to the light itself."""
    data = bpy.data.lights.new(name, kind)
    data.energy, data.color = energy, color
    for key, value in settings.items():
        setattr(data, key, value)
    return aim(add_object(name, data, into, location=location), target)


def camera(location, target, lens=35.0):
    """The scene's perspective camera."""
    data = bpy.data.cameras.new("Camera")
    data.lens, data.clip_start, data.clip_end = lens, 0.1, 200.0
    made = aim(add_object("Camera", data, location=location), target)
    bpy.context.scene.camera = made
    return made


def sky(bottom, top=None, strength=1.0):
    """World light: one colour, or a ramp from the horizon to the zenith."""
    world = bpy.data.worlds.new("Sky")
    bpy.context.scene.world = world
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (*bottom, 1.0)
    background.inputs["Strength"].default_value = strength
    if top:
        nodes, link = world.node_tree.nodes, world.node_tree.links.new
        where, split, ramp = map(
            nodes.new, ("ShaderNodeTexCoord", "ShaderNodeSeparateXYZ", "ShaderNodeValToRGB")
        )
        ramp.color_ramp.elements[0].color = (*bottom, 1.0)
        ramp.color_ramp.elements[1].color = (*top, 1.0)
        ramp.color_ramp.elements[1].position = 0.6
        link(where.outputs["Generated"], split.inputs[0])
        link(split.outputs["Z"], ramp.inputs[0])
        link(ramp.outputs[0], background.inputs["Color"])


def evaluated_meshes():
    """Every evaluated mesh in the scene, once an instance, with its world matrix."""
    for item in bpy.context.evaluated_depsgraph_get().object_instances:
        if item.object.type in {"MESH", "CURVE", "FONT", "META", "SURFACE"} and item.show_self:
            shape = item.object.to_mesh()
            if shape is not None:
                yield item.object, shape, np.array(item.matrix_world)
                item.object.to_mesh_clear()


def statistics():
    """Triangles, instances and a digest of all evaluated positions, at the current frame."""
    digest, triangles, drawn = hashlib.sha256(), 0, 0
    for _, shape, matrix in evaluated_meshes():
        positions = np.empty(len(shape.vertices) * 3, np.float32)
        shape.vertices.foreach_get("co", positions)
        digest.update(positions.tobytes())
        digest.update(np.round(matrix, 5).tobytes())
        triangles += len(shape.loop_triangles)
        drawn += 1
    return {"triangles": triangles, "drawn": drawn, "digest": digest.hexdigest()[:12]}


def opens_with(**effects):
    """Whoever opens the file looks through its camera, with the sidebar beside it, Strata's preview on and
    these effects switched on or off. Written as Strata keeps it, so that Strata need not be there."""
    scene = bpy.context.scene
    settings = {effect: {"enabled": is_on} for effect, is_on in effects.items()}
    settings |= {"version": 3, "preview": {"on_opening": True}}  # of addon/ui/migration.py
    scene.bl_system_properties_get(do_create=True)["strata"] = settings
    for screen in bpy.data.screens:
        for space in (area.spaces.active for area in screen.areas if area.type == "VIEW_3D"):
            space.region_3d.view_perspective = "CAMERA"
            space.show_region_ui = True


def save(path):
    """Purge what nothing uses and save compressed; returns the size in bytes."""
    bpy.data.orphans_purge(do_recursive=True)
    bpy.context.preferences.filepaths.save_version = 0
    for screen in bpy.data.screens:
        for space in (space for area in screen.areas for space in area.spaces):
            if space.type == "FILE_BROWSER" and space.params:
                space.params.directory = b"//"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=True, copy=True)
    return Path(path).stat().st_size
