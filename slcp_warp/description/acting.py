"""Which numbers of a parameter stand for something that a scene has.

A table of parameters has a number for every degree of freedom, pair or shape, also where a joint has no limit
or spring and a pair no friction: no kernel reads it there.
"""

from slcp_warp.kernels.structure import RECTANGLE, Structure

from .scene import Scene

OF_DOFS = ("damping", "lower", "upper", "stiffness", "rest", "armature")
OF_PAIRS = ("friction", "restitution")
OF_SHAPES = ("radius", "corner_radius", "shape_offset", "shape_angle", "surface_ratio")

# what a part was built without
BUILT = {
    "lower": "without a lower limit",
    "upper": "without an upper limit",
    "stiffness": "without a spring",
    "rest": "without a spring",
    "armature": "without an armature",
    "friction": "without friction",
    "restitution": "without restitution",
    "corner_radius": "without corners",
    "surface_ratio": "without a surface that runs",
    "tendon_force_limit": "without a limit of its force",
    "tendon_force_sigma": "without a limit of its force",
    "shape_angle": "with the angle 0, which the kernels leave out",
}


def acting(structure: Structure, name: str) -> list[bool]:
    """Of a parameter of `BUILT`, one for every row: whether it stands for something."""
    s = structure
    if name in ("lower", "upper"):
        return list(s.lower if name == "lower" else s.upper)
    if name in ("stiffness", "rest"):
        return [j in s.sprung for j in range(s.nv if s.sprung else 0)]
    if name == "armature":
        return [j in s.armature for j in range(s.nv if s.armature else 0)]
    if name == "friction":
        return [pair.friction for pair in s.pairs]
    if name == "restitution":
        return [pair.restitution for pair in s.pairs]
    if name == "surface_ratio":
        return [shape.driver >= 0 for shape in s.shapes]
    if name in ("tendon_force_limit", "tendon_force_sigma"):
        return [i in s.limited for i in range(len(s.tendons) if s.limited else 0)]
    if name == "corner_radius":
        return [shape.kind == RECTANGLE for shape in s.shapes]
    return [shape.turned for shape in s.shapes]


def parts_of(scene: Scene, name: str) -> list[str]:
    """Names of the parts that a parameter's rows are of; none for what has no names."""
    if name in ("mass", "inertia", "com", "anchor", "angle", "axis"):
        return [body.name for body in scene.bodies]
    if name in OF_DOFS:
        return list(scene.state_names[: scene.nv])
    if name in OF_SHAPES:
        return [shape.name for shape in scene.shapes]
    if name.startswith("spring_"):
        return list(scene.spring_names)
    if name == "tendon_coefficient":
        return [f"{tendon.name} {scene.state_names[j]}"
                for tendon, dofs in zip(scene.tendons, scene.structure.tendons) for j in dofs]  # fmt: skip
    if name.startswith("tendon_"):
        return [tendon.name for tendon in scene.tendons]
    of = {"gear": scene.control_names, "sigma": scene.row_names}
    of |= dict.fromkeys(OF_PAIRS, scene.pair_names)
    return list(of.get(name, ()))
