"""What a scene remembers of its reconstruction: `scene.dgs`. Every length says its unit."""

from __future__ import annotations

from typing import Any

import bpy

from ...core.effects.choices import effect_items
from ..data_sets import take_data_set
from ..laboratory.media.registry import MEDIA
from ..photos import forget
from ..window import redraw_views
from .watching import watch

#: Paths from the .blend on ('//') may be given. Blender 5 shows them in red where a property does not say so.
_RELATIVE: set[str] = {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (5, 0) else set()
_PRESETS = (
    (
        "draft",
        "Draft",
        "300 steps, 25,000 Gaussians (of sharp photos more): a first impression, about half a minute on two cores",
    ),
    (
        "balanced",
        "Balanced",
        "1,000 steps, 40,000 Gaussians (of sharp photos 1,500 and up to 120,000): about a minute on two cores",
    ),
    (
        "fine",
        "Fine",
        "2,000 steps, 56,000 Gaussians (of sharp photos 3,000 and up to 168,000): twice as long or more; "
        "blurred photos gain a tenth of a decibel, sharp ones one or more",
    ),
    ("best", "Best", "As long as held-out photos gain, 12,000 steps and 139,000 Gaussians at most: many minutes"),
)
_MEDIA = (
    ("none", "None", "Nothing lies before the object: ordinary Gaussian splatting"),
    ("gaussian", "Gaussian", "Light is scattered alike in all directions, as by fog, frosted glass or thin tissue"),
    ("ellipse", "Elliptic Gaussian", "Light is scattered further in one direction than in the other"),
    ("auto", "From Photos", "A Gaussian whose width is estimated from all photos; the report says how sure it is"),
    ("auto-each", "From Each Photo", "A Gaussian for each photo, for a medium that changes while photos are taken"),
    ("file", "Measured", "A measured point spread function from a file (.npy, .tif, .png, .fits)"),
)
_TEST_MEDIA = (
    ("psf", "As in Step 3", "The photos are blurred by a convolution with the medium of step 3"),
    *((spec.name, spec.label, spec.description) for spec in MEDIA),
)
_CAMERAS = (
    ("photos", "From Photos", "Find the cameras from the photos themselves (structure from motion)"),
    ("model", "From a File", "Cameras that another program found, such as a COLMAP model or a transforms.json"),
    ("scene", "Scene Cameras", "Cameras of this scene that are named as the photos are"),
)


def _read_photos(settings: Any, _context: Any) -> None:
    """Another folder: all its photos count, it has its own results and thumbnails, and may have cameras of its own."""
    settings.selection = ""
    forget()
    take_data_set(settings)


def _watch(settings: Any, _context: Any) -> None:
    watch(settings.id_data)


def _redraw_views(_settings: Any, _context: Any) -> None:
    redraw_views()


class DGS_PG_settings(bpy.types.PropertyGroup):
    """The settings of all steps; the panel shows them, the job reads them."""

    photos: bpy.props.StringProperty(
        name="Photos",
        subtype="DIR_PATH",
        options=_RELATIVE,
        update=_read_photos,
        description="Folder with the photos: PNG, JPEG, TIFF, WebP, BMP or HEIC, at least three. Or a movie, or a"
        " data set with photos and cameras",
    )
    selection: bpy.props.StringProperty(
        name="Chosen Photos",
        options={"HIDDEN"},
        description="Names of the photos in the folder that count, one a line. Empty: all",
    )
    frames: bpy.props.IntProperty(
        name="Frames",
        min=3,
        soft_max=300,
        default=60,
        description="Frames of the movie to use at most: the sharpest one of each of as many equal parts",
    )
    masks: bpy.props.StringProperty(
        name="Masks",
        subtype="DIR_PATH",
        options=_RELATIVE,
        description="Folder with a mask for each photo, of the same name; black pixels are left out",
    )
    background: bpy.props.EnumProperty(
        name="Background",
        items=(
            ("auto", "Automatic", "White behind transparent photos, or a plain colour that all photos show"),
            ("none", "None", "Opaque photos show the scene up to their borders"),
            ("white", "White", "White is behind the object, and nothing else"),
            ("black", "Black", "Black is behind the object, and nothing else"),
        ),
        description="What is behind the object and counts as empty space",
    )
    out: bpy.props.StringProperty(
        name="Results",
        subtype="DIR_PATH",
        options=_RELATIVE,
        description="Folder for everything that is written; beside the photos if empty",
    )
    max_size: bpy.props.IntProperty(
        name="Longest Side",
        min=0,
        soft_max=8000,
        default=0,
        subtype="PIXEL",
        description="Shrink photos to this longer side, in pixels; cameras and medium shrink along. 0: never",
    )

    cameras: bpy.props.EnumProperty(name="Cameras", items=_CAMERAS, description="Where the cameras come from")
    model: bpy.props.StringProperty(
        name="Model",
        subtype="FILE_PATH",
        options=_RELATIVE,
        description="A file of cameras or a folder with one, such as a transforms.json or the folder of a COLMAP model",
    )
    model_of_set: bpy.props.StringProperty(
        name="Cameras of the Photos",
        options={"HIDDEN"},
        description="The model that came with the photos; other photos do not keep it",
    )

    medium: bpy.props.EnumProperty(
        name="Medium", items=_MEDIA, default="auto", description="What lies between the cameras and the object"
    )
    sigma: bpy.props.FloatProperty(
        name="Sigma",
        min=0.1,
        soft_max=20.0,
        max=200.0,
        default=3.0,
        precision=2,
        description="Standard deviation of the blur, in pixels of the photos as they are in their files",
    )
    sigma_minor: bpy.props.FloatProperty(
        name="Sigma Across",
        min=0.1,
        soft_max=20.0,
        max=200.0,
        default=2.0,
        precision=2,
        description="Standard deviation of the blur across its long direction, in pixels of the photos",
    )
    angle: bpy.props.FloatProperty(
        name="Angle",
        subtype="ANGLE",
        soft_min=-3.1416,
        soft_max=3.1416,
        default=0.0,
        description="Direction of the widest blur, from the photo's x axis towards its y axis (down)",
    )
    psf_file: bpy.props.StringProperty(
        name="Point Spread",
        subtype="FILE_PATH",
        options=_RELATIVE,
        description="Image of a point seen through the medium, at the photos' pixel size, centred",
    )
    blur_space: bpy.props.EnumProperty(
        name="Blur Acts On",
        description="The values that the medium mixes",
        items=(
            ("srgb", "Encoded Values", "The photos' sRGB values: made-up blur, or video-processed photos"),
            ("linear", "Light", "Linear light: what a real medium mixes before the camera encodes it"),
        ),
    )

    effects: bpy.props.EnumProperty(
        name="Other Effects",
        items=effect_items(),
        default="auto",
        description="What is simulated besides the blur: what photos need, or one effect",
    )
    adjust_cameras: bpy.props.EnumProperty(
        name="Adjust Cameras",
        items=[
            ("auto", "As Needed", "Cameras found in photos; others only if the photos contradict them"),
            ("never", "Never", "Keep them as they are: to measure by exact cameras"),
            ("always", "Always", "Given ones, too: they are only roughly right"),
        ],
        default="auto",
        description="Move the cameras of shaken photos together with the twin",
    )
    refine_cameras: bpy.props.BoolProperty(
        name="Refine Cameras",
        description="Move cameras to where their photos fit all others; kept only where photos then fit clearly better",
    )

    preset: bpy.props.EnumProperty(
        name="Preset", items=_PRESETS, default="balanced", description="How much time to spend"
    )
    time_limit: bpy.props.FloatProperty(
        name="Time Limit",
        min=0.0,
        soft_max=120.0,
        default=0.0,
        precision=1,
        description="Minutes from the start to the report; the run is planned to fit. 0: no limit",
    )
    max_gaussians: bpy.props.IntProperty(
        name="Most Gaussians", min=0, soft_max=1_000_000, default=0, description="0 for the preset's own number"
    )
    sh_degree: bpy.props.EnumProperty(
        name="Gloss",
        default="preset",
        description="How finely colours change with the direction of view",
        items=(
            ("preset", "As the Preset", ""),
            ("0", "None", "Matt surfaces only; the smallest files"),
            ("1", "Simple", "Spherical harmonics up to degree 1; all that Blender shows"),
            ("2", "Fine", "Up to degree 2; for other viewers"),
            ("3", "Finest", "Up to degree 3; for other viewers, the largest files"),
        ),
    )
    holdout_every: bpy.props.IntProperty(
        name="Keep Out Every",
        min=0,
        soft_max=20,
        default=8,
        description="Keep every n-th photo out of the optimization to measure accuracy on it; 0 keeps none out",
    )
    seed: bpy.props.IntProperty(
        name="Seed", min=0, default=0, description="The same seed gives the same twin on the CPU"
    )
    device: bpy.props.EnumProperty(
        name="Device",
        description="Where to compute",
        items=(
            ("auto", "Automatic", "A graphics card of its own where the training is quicker there, else the CPU"),
            ("cpu", "CPU", ""),
            ("gpu", "Graphics Card", "Any maker's, through Vulkan, Metal or DirectX 12"),
        ),
    )
    threads: bpy.props.IntProperty(
        name="Threads",
        min=0,
        soft_max=64,
        default=0,
        description="CPU threads of the engine; 0 for all cores. Fewer leave more of the machine to Blender",
    )
    add_when_done: bpy.props.BoolProperty(
        name="Add Twin When Done",
        default=True,
        description="Put the twin and its cameras into this scene as soon as they are there",
    )
    live: bpy.props.BoolProperty(
        name="Live Twin",
        default=False,
        description="Show the twin so far in the scene while it is optimized; costs a redraw every few seconds",
    )

    truth: bpy.props.StringProperty(
        name="Sharp Photos",
        subtype="DIR_PATH",
        options=_RELATIVE,
        description="Photos without the medium, of the same names: only to measure the twin against",
    )
    test_set: bpy.props.StringProperty(
        name="Folder",
        subtype="DIR_PATH",
        options=_RELATIVE,
        description="Folder for the test set: photos, sharp photos and cameras are written there",
    )
    test_views: bpy.props.IntProperty(
        name="Photos", min=3, soft_max=200, default=24, description="Photos of the test set, from all sides"
    )
    test_width: bpy.props.IntProperty(
        name="Width",
        min=64,
        soft_max=2000,
        default=400,
        subtype="PIXEL",
        description="Width of the test set's photos, in pixels; they are two thirds as high",
    )
    test_medium: bpy.props.EnumProperty(
        name="Through", items=_TEST_MEDIA, default="psf", description="What stands between the camera and the object"
    )
    test_values: bpy.props.StringProperty(
        name="Strength", description="Values of the medium, as the line below says. Empty: what suits the set"
    )
    test_sharp: bpy.props.FloatProperty(
        name="Sharp",
        min=0.0,
        max=1.0,
        default=0.0,
        subtype="FACTOR",
        description="Share of the photos that are taken without it, besides every eighth, which is held out",
    )
    new_photos: bpy.props.StringProperty(
        name="New Photos",
        subtype="DIR_PATH",
        options=_RELATIVE,
        description="Folder with later photos of the same object, taken through the same medium or another",
    )
    watching: bpy.props.BoolProperty(
        name="Watch Folder",
        default=False,
        update=_watch,
        description="Update the twin whenever new photos have come into the folder",
    )
    known_length: bpy.props.FloatProperty(
        name="Known Length",
        subtype="DISTANCE",
        unit="LENGTH",
        min=1e-6,
        soft_max=100.0,
        default=1.0,
        description="True distance between the two selected objects, or true length of the way through all cameras",
    )
    changed: bpy.props.StringProperty(
        name="Changed Settings",
        options={"HIDDEN"},
        description="What was changed of this scene's own settings for a twin: before and after, as JSON",
    )
    exact_view: bpy.props.PointerProperty(
        name="Exact View",
        type=bpy.types.Image,
        options={"HIDDEN"},
        description="The engine's last picture of this scene, packed into the file",
    )
    exact_other: bpy.props.PointerProperty(
        name="Other Exact View",
        type=bpy.types.Image,
        options={"HIDDEN"},
        description="The same view blurred where that one is sharp, and sharp where it is blurred",
    )
    exact_of: bpy.props.StringProperty(
        name="Exact View Of", options={"HIDDEN"}, description="What that picture was made of, as a checksum"
    )
    split_shown: bpy.props.BoolProperty(
        name="Compare",
        default=False,
        update=_redraw_views,
        description="Show the exact view in the camera's frame of the 3D view, beside what is chosen here",
    )
    split_at: bpy.props.FloatProperty(
        name="Split",
        min=0.0,
        max=1.0,
        default=0.5,
        subtype="FACTOR",
        update=_redraw_views,
        description="Where the exact view ends and the other picture begins; or drag the line in the 3D view",
    )
    split_against: bpy.props.EnumProperty(
        name="Against",
        update=_redraw_views,
        description="What is at the right of the line",
        items=(
            ("photo", "Photo", "The photo that was taken from there"),
            ("truth", "Sharp Photo", "The photo without the medium, of the same name, in the folder of sharp photos"),
            ("medium", "Other View", "The twin through the medium where the left side is sharp; sharp where it is not"),
            (
                "difference",
                "Difference",
                "Four times the difference: of the sharp view from the sharp photo where there"
                " is one, else of the view through the medium from the photo",
            ),
        ),
    )
    measure_edges: bpy.props.BoolProperty(
        name="Snap to Edges",
        default=True,
        description="A place that is set lies on the edge or corner that is nearest, within four px of the photos",
    )
    view_kind: bpy.props.EnumProperty(
        name="Show",
        description="What the exact view shows",
        items=(
            ("sharp", "Sharp", "The twin as the engine renders it, sharp"),
            ("medium", "Blurred", "The twin blurred by the medium of step 3, as the photos are"),
        ),
    )


def register_properties() -> None:
    """Adds `scene.dgs`."""
    bpy.types.Scene.dgs = bpy.props.PointerProperty(type=DGS_PG_settings, name="Descatter")


def unregister_properties() -> None:
    """Takes `scene.dgs` out; what files hold of it stays in them."""
    del bpy.types.Scene.dgs
