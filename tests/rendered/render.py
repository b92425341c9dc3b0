"""Renders films of balls that strike a surface with Blender's path tracer, each with its truth.

The films are independent of ricochet's own simulator: real shading, highlights, reflections, cast and contact shadows,
depth of grounds, and the noise of a path tracer and of a camera. What a seed draws at random: pattern, size, light, ground,
speed, spin, restitution and length of the contact. The contact is a half sine of force.

    python3.11 -m venv blender && blender/bin/pip install bpy==4.5.15
    blender/bin/python tests/rendered/render.py plain 1 films/plain_1

writes film.npy, rig.toml, truth.csv (px, y down, degrees, counter-clockwise on the screen), truth_impact.csv (m, s, rad) and
scene.json. A film takes a minute or two on two cores. `compare.py` measures and compares them.
"""

import json
import math
import pathlib
import sys
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Quaternion, Vector

UNITS_PER_PX = 0.01
GRAVITY_M_S2 = 9.80665
SAMPLES_PER_PIXEL = 18
TEXTURE_SHAPE = (1024, 2048)

# Each kind of film with the pattern of its ball.
KINDS = {
    "speckle": "speckle", "coarse": "coarse", "pen": "pen", "futsal": "discs", "seams": "seams", "ring": "ring",
    "segments": "segments", "logo": "logo", "felt": "felt", "golf": "golf", "plain": "plain", "steel": "plain",
    "backlit": "plain", "small": "plain", "smallspeckle": "coarse", "perspective": "speckle", "blur": "speckle",
    "bright": "speckle", "enter": "speckle", "arc": "speckle", "paddle": "speckle",
}


class Texture:
    """A pattern on a sphere as an image of longitude and latitude, in reflectance."""

    def __init__(self, draw):
        self.draw = draw
        rows, columns = TEXTURE_SHAPE
        latitude = ((np.arange(rows) + 0.5) / rows - 0.5) * math.pi
        longitude = ((np.arange(columns) + 0.5) / columns - 0.5) * 2 * math.pi
        latitude, longitude = np.meshgrid(latitude, longitude, indexing="ij")
        self.points = np.stack(
            [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)], -1
        )
        self.paint, self.ink = draw.uniform(0.35, 0.8), draw.uniform(0.02, 0.08)
        if draw.random() < 0.15:
            self.paint, self.ink = self.ink + 0.03, self.paint
        self.image = np.full(TEXTURE_SHAPE, self.paint)

    def direction(self):
        """Returns a random unit vector."""
        vector = self.draw.normal(size=3)
        return vector / np.linalg.norm(vector)

    def frame(self):
        """Returns three random perpendicular unit vectors."""
        first = self.direction()
        second = np.cross(first, self.direction())
        second /= np.linalg.norm(second)
        return first, second, np.cross(first, second)

    def cover(self, share, level):
        """Covers a share of each point, 0 to 1, with a reflectance."""
        self.image = self.image * (1 - share) + level * share

    def discs(self, count, radius_rad, level):
        """Draws discs at random places; `radius_rad` is their range."""
        for _ in range(count):
            self.disc(self.direction(), self.draw.uniform(*radius_rad), level)

    def disc(self, middle, radius_rad, level):
        """Draws one disc with a soft edge."""
        angle = np.arccos(np.clip(self.points @ middle, -1, 1))
        self.cover(1 / (1 + np.exp((angle - radius_rad) / 0.005)), level)

    def band(self, axis, width_rad, level, latitude_rad=0.0):
        """Draws a circle of latitude about an axis."""
        away = np.abs(np.arcsin(np.clip(self.points @ axis, -1, 1)) - latitude_rad)
        self.cover(1 / (1 + np.exp((away - width_rad) / 0.01)), level)

    def stroke(self, level):
        """Draws a short line of a pen."""
        middle, along, across = self.frame()
        place = np.arctan2(self.points @ along, self.points @ middle)
        away = np.abs(np.arcsin(np.clip(self.points @ across, -1, 1)))
        length, width = self.draw.uniform(0.1, 0.35), self.draw.uniform(0.012, 0.025)
        self.cover(((np.abs(place) < length) & (away < width) & (self.points @ middle > 0)).astype(float), level)

    def grain(self, waves_per_rad, contrast):
        """Adds a random pattern of plane waves."""
        waves = [
            np.cos(self.points @ (self.direction() * waves_per_rad * self.draw.uniform(0.5, 1.5)) + self.draw.uniform(0, 6.28))
            for _ in range(24)
        ]
        self.image = self.image + contrast * self.paint * sum(waves) / math.sqrt(12)

    def letters(self):
        """Draws three words of upright and level strokes."""
        for _ in range(3):
            middle, along, across = self.frame()
            x, y = np.arctan2(self.points @ along, self.points @ middle), np.arcsin(np.clip(self.points @ across, -1, 1))
            for letter in range(6):
                place = x + 0.35 - 0.12 * letter
                upright = (np.abs(place) < 0.04) & (np.abs(y) < self.draw.uniform(0.05, 0.15))
                level = (np.abs(place) < 0.05) & (np.abs(y - self.draw.uniform(-0.1, 0.1)) < 0.02)
                self.image[(upright | level) & (self.points @ middle > 0)] = self.ink

    def pattern(self, name):
        """Draws a pattern and returns its image."""
        getattr(self, f"draw_{name}", lambda: None)()
        return np.clip(self.image, 0.005, 0.95)

    def draw_speckle(self):
        self.discs(int(self.draw.uniform(350, 900)), (0.03, 0.08), self.ink)

    def draw_coarse(self):
        self.discs(int(self.draw.uniform(60, 140)), (0.08, 0.16), self.ink)

    def draw_pen(self):
        for _ in range(int(self.draw.uniform(8, 22))):
            self.stroke(self.ink)
        self.discs(int(self.draw.uniform(4, 10)), (0.025, 0.05), self.ink)

    def draw_discs(self):
        golden = (1 + 5**0.5) / 2
        for a in (-1, 1):
            for b in (-golden, golden):
                for corner in ([0, a, b], [a, b, 0], [b, 0, a]):
                    self.disc(np.array(corner) / np.linalg.norm(corner), 0.33, self.ink)

    def draw_seams(self):
        self.image *= 0.6
        first, second, third = self.frame()
        for axis, latitude in ((first, 0.0), (second, 0.0), (third, -0.6), (third, 0.6)):
            self.band(axis, 0.02, self.ink, latitude)
        self.grain(90, 0.03)

    def draw_ring(self):
        axis = self.direction()
        self.band(axis, self.draw.uniform(0.05, 0.15), self.ink)
        self.band(axis, 0.04, self.ink, self.draw.uniform(0.4, 0.7))
        self.discs(6, (0.05, 0.1), self.ink)

    def draw_segments(self):
        count = int(self.draw.integers(3, 7))
        _, along, across = self.frame()
        turn = np.arctan2(self.points @ across, self.points @ along) / (2 * math.pi) + 0.5
        self.image = np.where(np.floor(turn * 2 * count) % 2 == 0, self.paint, self.paint * 0.35)

    def draw_logo(self):
        self.letters()

    def draw_felt(self):
        self.image *= 0.8
        self.grain(40, 0.08)
        self.grain(100, 0.08)


@dataclass
class Motion:
    """A ball that falls, strikes a level surface and rebounds, in px and frames, y up from the first contact."""

    radius: float
    approach: float
    slide: float
    spin_deg: float
    restitution: float
    contact: float
    start: float
    gravity: float
    x: float
    y_down: float
    slide_change: float
    spin_change_deg: float
    surface_speed: float = 0.0

    def impulse(self, time):
        """Returns the share of the impulse so far, and its integral over time."""
        share = min(max((time - self.start) / self.contact, 0.0), 1.0)
        force = (1 - math.cos(math.pi * share)) / 2
        since = max(time - self.start - self.contact, 0.0)
        return force, (share - math.sin(math.pi * share) / math.pi) * self.contact / 2 + since

    def state(self, time):
        """Returns x, y (down), angle in degrees and their rates."""
        done, sum_of_it = self.impulse(time)
        since = time - self.start
        rebound = self.restitution * (self.approach + self.surface_speed) + self.surface_speed
        height = -self.approach * since + (self.approach + rebound) * sum_of_it - self.gravity * since**2 / 2
        climb = -self.approach + (self.approach + rebound) * done - self.gravity * since
        return (
            self.x + self.slide * since + self.slide_change * sum_of_it,
            self.y_down - height,
            self.spin_deg * time + self.spin_change_deg * sum_of_it,
            self.slide + self.slide_change * done,
            -climb,
            self.spin_deg + self.spin_change_deg * done,
        )


@dataclass
class Film:
    """What a film shows, drawn at random."""

    kind: str
    draw: np.random.Generator
    width: int
    height: int
    frames: int
    frame_rate: float
    mm_per_px: float
    motion: Motion


def draw_film(kind, seed):
    """Draws the camera and the motion of a film."""
    draw = np.random.default_rng([seed, sum(map(ord, kind))])
    u = draw.uniform
    width, height = int(draw.choice([224, 256, 288, 320])), int(draw.choice([208, 240, 256]))
    radius = u(7, 16) if kind.startswith("small") else u(130, 200) if kind == "arc" else u(34, 52)
    frames, frame_rate, mm_per_px = int(u(40, 60)), float(draw.choice([1000, 2000, 4000, 5000])), u(0.4, 2.5)
    start, contact = u(0.42, 0.58) * frames, u(2.5, 14)
    approach, slide, spin = u(1.2, 5.5), u(-3, 3), u(-6, 6)
    x, y = width / 2 + u(-20, 20), u(0.8, 0.9) * height - radius
    if kind == "arc":
        x, y, approach, slide, spin = width / 2, height - 20 - radius, u(0.8, 2), u(-0.8, 0.8), u(-0.8, 0.8)
    elif kind == "enter":
        approach, slide = u(3.5, 7), u(-2, 2)
    else:
        # The whole ball stays in the picture.
        approach = min(approach, max(0.4, (y - radius * 1.15) / start))
        reach = max(0.0, (width / 2 - radius * 1.15) / start)
        slide = min(max(slide, -reach), reach)
    restitution = u(0.4, 0.9)
    slowed = -math.copysign(min(u(0.1, 0.4) * (1 + restitution) * approach, 0.3 * abs(slide)), slide)
    turned = 0.0 if kind == "arc" else math.degrees(-2.5 * slowed / radius)
    gravity = GRAVITY_M_S2 / (mm_per_px * 1e-3) / frame_rate**2
    surface = u(0.4, 1.0) if kind == "paddle" else 0.0
    motion = Motion(
        radius, approach, slide, spin, restitution, contact, start, gravity, x, y, slowed, turned, surface
    )
    return Film(kind, draw, width, height, frames, frame_rate, mm_per_px, motion)


class Stage:
    """The scene of a film: camera, ball, surface, wall, lamps. x to the right, y into the picture, z up."""

    def __init__(self, film):
        self.film, self.u = film, film.draw.uniform
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self.scene = bpy.context.scene
        self.set_up_renderer()
        self.set_up_camera()
        self.ball = self.add_ball()
        self.surface = self.add_surface()
        self.add_wall()
        self.add_lamps()
        if film.kind == "blur":
            self.add_motion_blur()

    def place(self, x_px, y_px):
        """Returns the place of a point of the picture in the plane of the ball."""
        film = self.film
        return Vector(((x_px - (film.width - 1) / 2) * UNITS_PER_PX, 0.0, ((film.height - 1) / 2 - y_px) * UNITS_PER_PX))

    def set_up_renderer(self):
        """Sets up linear pictures without any tone curve, so that clipping is that of the camera."""
        render, cycles = self.scene.render, self.scene.cycles
        render.engine, cycles.device, cycles.use_denoising = "CYCLES", "CPU", False
        cycles.samples, cycles.max_bounces, render.use_persistent_data = SAMPLES_PER_PIXEL, 3, True
        render.resolution_x, render.resolution_y, render.resolution_percentage = self.film.width, self.film.height, 100
        settings = render.image_settings
        settings.file_format, settings.color_depth, settings.color_mode = "OPEN_EXR", "32", "RGB"
        self.scene.view_settings.view_transform = "Raw"

    def set_up_camera(self):
        """Sets up a camera far away, or one in perspective at 25 to 45 radii."""
        film = self.film
        camera = bpy.data.cameras.new("camera")
        place = bpy.data.objects.new("camera", camera)
        self.scene.collection.objects.link(place)
        self.scene.camera, camera.clip_end = place, 1000
        place.rotation_euler = (math.pi / 2, 0, 0)
        side = max(film.width, film.height) * UNITS_PER_PX
        if film.kind == "perspective":
            distance = film.motion.radius * UNITS_PER_PX * self.u(25, 45)
            place.location, camera.type = (0, -distance, 0), "PERSP"
            camera.angle = 2 * math.atan(side / 2 / distance)
        else:
            place.location, camera.type, camera.ortho_scale = (0, -20, 0), "ORTHO", side

    def material(self, name, roughness, gloss, metallic=0.0):
        """Returns a new material and its shader."""
        material = bpy.data.materials.new(name)
        material.use_nodes = True
        shader = material.node_tree.nodes["Principled BSDF"]
        shader.inputs["Roughness"].default_value = roughness
        shader.inputs["Specular IOR Level"].default_value = gloss
        shader.inputs["Metallic"].default_value = metallic
        return material, shader

    def add_ball(self):
        """Adds the ball with its pattern, half of them glossy."""
        film, u = self.film, self.u
        bpy.ops.mesh.primitive_uv_sphere_add(segments=320, ring_count=160, radius=film.motion.radius * UNITS_PER_PX)
        ball = bpy.context.object
        bpy.ops.object.shade_smooth()
        ball.rotation_mode = "QUATERNION"
        is_glossy = film.draw.random() < 0.5
        material, shader = self.material("ball", *((u(0.08, 0.3), u(0.3, 0.7)) if is_glossy else (u(0.5, 0.95), u(0, 0.3))))
        self.paint_ball(material, shader)
        ball.data.materials.append(material)
        self.first_turn = Quaternion([float(x) for x in film.draw.normal(size=4)]).normalized()
        return ball

    def paint_ball(self, material, shader):
        """Gives the ball its colour: steel, black, plain, or a pattern."""
        film, u = self.film, self.u
        pattern = KINDS[film.kind]
        if film.kind == "steel":
            shader.inputs["Metallic"].default_value, shader.inputs["Roughness"].default_value = 1.0, u(0.05, 0.3)
            return
        if film.kind == "backlit" or pattern in ("plain", "golf"):
            level = 0.02 if film.kind == "backlit" else u(0.4, 0.8)
            shader.inputs["Base Color"].default_value = (level, level, level, 1)
            if pattern == "golf":
                self.add_dimples(material, shader)
            return
        rows, columns = TEXTURE_SHAPE
        image = bpy.data.images.new("pattern", columns, rows, float_buffer=True)
        image.colorspace_settings.name = "Non-Color"
        pixels = np.ones((rows, columns, 4), np.float32)
        pixels[..., :3] = Texture(film.draw).pattern(pattern)[..., None]
        image.pixels.foreach_set(pixels.ravel())
        nodes, links = material.node_tree.nodes, material.node_tree.links
        node = nodes.new("ShaderNodeTexImage")
        node.image = image
        links.new(node.outputs["Color"], shader.inputs["Base Color"])

    def add_dimples(self, material, shader):
        """Gives the ball dimples, which are light and shade alone."""
        nodes, links = material.node_tree.nodes, material.node_tree.links
        cells, place, bump = (nodes.new(f"ShaderNode{name}") for name in ("TexVoronoi", "TexCoord", "Bump"))
        cells.inputs["Scale"].default_value = self.u(2.8, 3.9) / (self.film.motion.radius * UNITS_PER_PX)
        bump.inputs["Strength"].default_value, bump.inputs["Distance"].default_value = 0.6, 0.03
        links.new(place.outputs["Object"], cells.inputs["Vector"])
        links.new(cells.outputs["Distance"], bump.inputs["Height"])
        links.new(bump.outputs["Normal"], shader.inputs["Normal"])

    def texture_material(self, name, roughness, gloss, levels, scale, is_striped=False):
        """Returns a material of stripes or of clouds between two reflectances."""
        material, shader = self.material(name, roughness, gloss)
        nodes, links = material.node_tree.nodes, material.node_tree.links
        texture = nodes.new("ShaderNodeTexWave" if is_striped else "ShaderNodeTexNoise")
        texture.inputs["Scale"].default_value = scale
        levels_node, place = nodes.new("ShaderNodeMapRange"), nodes.new("ShaderNodeTexCoord")
        levels_node.inputs["To Min"].default_value, levels_node.inputs["To Max"].default_value = levels
        links.new(place.outputs["Object"], texture.inputs["Vector"])
        links.new(texture.outputs[0], levels_node.inputs["Value"])
        links.new(levels_node.outputs[0], shader.inputs["Base Color"])
        return material

    def add_surface(self):
        """Adds the surface: a floor seen from 6 to 14 degrees above, or a paddle."""
        film, u = self.film, self.u
        if film.kind == "paddle":
            bpy.ops.mesh.primitive_cube_add(size=1)
            surface = bpy.context.object
            surface.scale = (u(150, 220) * UNITS_PER_PX, 1.2, u(10, 16) * UNITS_PER_PX)
        else:
            bpy.ops.mesh.primitive_plane_add(size=60)
            surface = bpy.context.object
            tilt = math.radians(4 if film.kind == "arc" else u(6, 14))
            surface.rotation_euler = (tilt, 0, 0)
            normal = Vector((0, -math.sin(tilt), math.cos(tilt)))
            motion = film.motion
            surface.location = self.place(motion.x, motion.y_down) - normal * (motion.radius * UNITS_PER_PX)
        low = u(0.03, 0.3)
        levels, is_striped = (low, low * u(1.1, 2.5)), film.draw.random() < 0.4
        material = self.texture_material("surface", u(0.3, 0.9), u(0.1, 0.5), levels, u(1, 12), is_striped)
        surface.data.materials.append(material)
        return surface

    def add_wall(self):
        """Adds the wall behind, which shines behind a back-lit ball."""
        film, u = self.film, self.u
        bpy.ops.mesh.primitive_plane_add(size=80)
        wall = bpy.context.object
        wall.rotation_euler, wall.location = (math.pi / 2, 0, 0), (0, u(2, 8), 0)
        if film.kind == "backlit" or (film.kind == "steel" and film.draw.random() < 0.5):
            material, shader = self.material("wall", 1.0, 0.0)
            shader.inputs["Emission Color"].default_value = (1, 1, 1, 1)
            shader.inputs["Emission Strength"].default_value = u(0.5, 0.8)
        else:
            low = u(0.4, 0.6) if film.kind == "bright" else u(0.02, 0.25)
            levels = (low, min(0.9, low * u(1, 3)))
            material = self.texture_material("wall", 0.9, 0.1, levels, u(0.5, 3))
        wall.data.materials.append(material)

    def add_lamps(self):
        """Adds one to three lamps in front, and light from everywhere."""
        film, u = self.film, self.u
        world = bpy.data.worlds.new("world")
        self.scene.world, world.use_nodes = world, True
        ambient = u(0.05, 0.35)
        world.node_tree.nodes["Background"].inputs[0].default_value = (ambient, ambient, ambient, 1)
        target = self.place(film.motion.x, film.motion.y_down)
        for number in range(int(film.draw.integers(1, 4))):
            azimuth, elevation, distance = math.radians(u(-75, 75)), math.radians(u(15, 75)), u(5, 9)
            lamp = bpy.data.lights.new("lamp", "AREA")
            lamp.size, share = u(0.3, 2.5), 1.0 if number == 0 else u(0.2, 0.6)
            lamp.energy = u(250, 700) * share * (distance / 6) ** 2 * (0.1 if film.kind == "backlit" else 1.0)
            place = bpy.data.objects.new("lamp", lamp)
            self.scene.collection.objects.link(place)
            towards = Vector((
                math.sin(azimuth) * math.cos(elevation), -math.cos(azimuth) * math.cos(elevation), math.sin(elevation)
            ))
            place.location = target + towards * distance
            place.rotation_euler = (target - place.location).to_track_quat("-Z", "Y").to_euler()

    def move_to(self, time):
        """Moves the ball, and a paddle, to a time in frames."""
        motion = self.film.motion
        x, y, angle, *_ = motion.state(time)
        self.ball.location = self.place(x, y)
        self.ball.rotation_quaternion = Quaternion((0, -1, 0), math.radians(angle)) @ self.first_turn
        if self.film.kind == "paddle":
            top = motion.y_down + motion.radius - motion.surface_speed * (time - motion.start)
            self.surface.location = self.place(motion.x, top) - Vector((0, 0, self.surface.scale[2] / 2))

    def add_motion_blur(self):
        """Blurs the ball over half of each frame."""
        render = self.scene.render
        render.use_motion_blur, render.motion_blur_shutter, render.motion_blur_position = True, 0.5, "CENTER"
        for frame in range(-1, self.film.frames + 1):
            self.move_to(float(frame))
            for path in ("location", "rotation_quaternion"):
                self.ball.keyframe_insert(path, frame=frame + 1)
        for curve in self.ball.animation_data.action.fcurves:
            for key in curve.keyframe_points:
                key.interpolation = "LINEAR"

    def render(self, frame, path):
        """Returns the radiance of one frame, by rows from the top."""
        if self.film.kind == "blur":
            self.scene.frame_set(frame + 1)
        else:
            self.move_to(float(frame))
        self.scene.cycles.seed = frame
        self.scene.render.filepath = str(path)
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(str(path), check_existing=False)
        image.colorspace_settings.name = "Non-Color"
        pixels = np.empty(self.film.width * self.film.height * 4, np.float32)
        image.pixels.foreach_get(pixels)
        bpy.data.images.remove(image)
        return pixels.reshape(self.film.height, self.film.width, 4)[::-1, :, 0]


def photograph(film, stage, folder):
    """Returns the frames as a camera of 8 bits sees them: shot and read noise, clipped where it is too bright."""
    u = film.draw.uniform
    read_noise, electrons, brightest, gain = u(0.4, 1.6), u(3000, 15000), u(150, 235), None
    frames = []
    for frame in range(film.frames):
        radiance = stage.render(frame, folder / "frame.exr")
        gain = gain or brightest / np.percentile(radiance, 99.5)
        expected = np.clip(radiance * gain, 0, 255)
        level = film.draw.poisson(expected / 255 * electrons) / electrons * 255
        level = level + film.draw.normal(0, read_noise, level.shape)
        frames.append(np.clip(np.round(level), 0, 255).astype(np.uint8))
    (folder / "frame.exr").unlink()
    return np.stack(frames)


def write_truth(film, folder):
    """Writes the poses of all frames and the quantities of the impact."""
    motion, rate = film.motion, film.frame_rate
    names = "frame,center_x_px,center_y_px,angle_deg,vx_px_per_frame,vy_px_per_frame,omega_deg_per_frame"
    rows = [",".join([str(k), *(f"{value:.6f}" for value in motion.state(float(k)))]) for k in range(film.frames)]
    (folder / "truth.csv").write_text("\n".join([names, *rows]) + "\n")
    start, end = motion.start, motion.start + motion.contact
    times = np.linspace(start, end, 4001)
    depths = [motion.state(time)[1] - motion.y_down for time in times]
    deepest, to_m_s = int(np.argmax(depths)), film.mm_per_px * 1e-3 * rate
    before, after = motion.state(start), motion.state(end)
    truth = {
        "start_s": start / rate,
        "deepest_s": times[deepest] / rate,
        "end_s": end / rate,
        "contact_time_s": motion.contact / rate,
        "vn_before_m_s": -before[4] * to_m_s,
        "vn_after_m_s": -after[4] * to_m_s,
        "vt_before_m_s": before[3] * to_m_s,
        "vt_after_m_s": after[3] * to_m_s,
        "omega_before_rad_s": math.radians(before[5]) * rate,
        "omega_after_rad_s": math.radians(after[5]) * rate,
        "restitution": -after[4] / before[4],
        "compression_max_mm": depths[deepest] * film.mm_per_px,
    }
    lines = [",".join(truth), ",".join(f"{value:.8g}" for value in truth.values())]
    (folder / "truth_impact.csv").write_text("\n".join(lines) + "\n")


def write_rig(film, folder):
    """Writes the rig file of the film, as a laboratory would."""
    size, step = (31, 8) if film.motion.radius > 30 else (9, 2)
    (folder / "rig.toml").write_text(
        f"""[rig]
name = "{film.kind}"

[camera]
source = "recording"
id = "film.mcap"

[scale]
mm_per_px = {film.mm_per_px}

[surface]
angle_deg = 0

[[body]]
name = "ball"
kind = "ball"
diameter_mm = {2 * film.motion.radius * film.mm_per_px}
mass_kg = 0.1

[correlation]
subset_size_px = {size}
step_px = {step}

[velocity]
gravity_m_s2 = {GRAVITY_M_S2}
"""
    )


def main():
    if len(sys.argv) != 4 or sys.argv[1] not in KINDS:
        sys.exit(f"usage: render.py KIND SEED FOLDER, where KIND is one of {', '.join(KINDS)}")
    kind, seed, folder = sys.argv[1], int(sys.argv[2]), pathlib.Path(sys.argv[3])
    folder.mkdir(parents=True, exist_ok=True)
    film = draw_film(kind, seed)
    np.save(folder / "film.npy", photograph(film, Stage(film), folder))
    write_truth(film, folder)
    write_rig(film, folder)
    (folder / "scene.json").write_text(json.dumps({"frame_rate_hz": film.frame_rate, **vars(film.motion)}, indent=1) + "\n")


if __name__ == "__main__":
    main()
