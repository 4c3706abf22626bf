"""The backdrop of every picture: floor, table, lights and background, none of which collides."""

from typing import TYPE_CHECKING

from jssa_gym.envs.camera import FIELD

if TYPE_CHECKING:
    import mujoco


def decorate(spec: "mujoco.MjSpec", table: float | None, pretty: bool, width: int, height: int) -> None:
    """Add the backdrop to a model.

    Args:
        spec: Of the model.
        table: Height of the table [m]; None for none.
        pretty: Shadows and smooth edges.
        width, height: Of the largest picture [pixels].
    """
    import mujoco

    visual = spec.visual
    visual.global_.offwidth, visual.global_.offheight, visual.global_.fovy = width, height, FIELD
    visual.quality.shadowsize = 2048 if pretty else 0
    visual.quality.offsamples = 4 if pretty else 0
    visual.map.shadowclip, visual.map.shadowscale = 3.2, 0.9
    visual.map.znear, visual.map.zfar = 0.02, 40.0
    visual.rgba.haze = [0.74, 0.78, 0.82, 1.0]
    visual.headlight.ambient = [0.40, 0.40, 0.42]
    visual.headlight.diffuse = [0.25, 0.25, 0.25]
    visual.headlight.specular = [0.2, 0.2, 0.2]
    spec.stat.extent, spec.stat.center = 1.5, [0.4, 0.0, 1.0]
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.93, 0.95, 0.97],
        rgb2=[0.62, 0.67, 0.73],
        width=256,
        height=1536,
    )
    spec.add_material(name="floor", rgba=[0.60, 0.62, 0.65, 1.0], specular=0.1, shininess=0.2)
    spec.add_material(name="table_top", rgba=[0.70, 0.71, 0.73, 1.0], specular=0.05, shininess=0.3)
    spec.add_material(name="table_body", rgba=[0.32, 0.34, 0.37, 1.0], specular=0.05, shininess=0.3)
    world = spec.worldbody
    for position, direction, diffuse, specular, casts in (
        ([1.5, -1.6, 3.6], [-0.42, 0.45, -1.0], 0.50, 0.6, True),
        ([-1.5, -1.5, 2.5], [0.8, 0.75, -0.45], 0.22, 0.15, False),
        ([0.0, 2.0, 2.5], [0.1, -1.0, -0.35], 0.22, 0.25, False),
    ):
        world.add_light(
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            pos=position,
            dir=direction,
            diffuse=[diffuse] * 3,
            specular=[specular] * 3,
            ambient=[0.0] * 3,
            castshadow=casts,
        )

    def box(size: list[float], pos: list[float], material: str) -> None:
        world.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=pos, material=material, contype=0, conaffinity=0)

    world.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 0.05], material="floor", contype=0, conaffinity=0)
    if table is not None:
        box([0.34, 0.40, 0.02], [0.03, 0.0, table - 0.02], "table_top")
        box([0.30, 0.36, (table - 0.04) / 2.0], [0.03, 0.0, (table - 0.04) / 2.0], "table_body")
