"""Simulators that the tests share: every (scene, options, precision) compiles kernels once per test run."""

import dataclasses
import functools

import numpy as np
import warp as wp
from random_scenes import random_tree

import slcp_warp as slcp
from slcp_warp import Actuator, Body, Contact, Scene, Shape, Spring, Tendon, scenes

WIDTH = {wp.float32: "float32", wp.float64: "float64"}
NUMPY = {wp.float32: np.float32, wp.float64: np.float64}


def driven_cart(mass: float = 2.0) -> Scene:
    """A cart that is pushed along a line, and touches nothing."""
    return Scene(
        "cart",
        bodies=(Body("cart", mass, 1.0, joint="prismatic"),),
        actuators=(slcp.Actuator("cart"),),
        gravity=(0.0, 0.0),
        step_size=0.1,
    )


def menagerie() -> Scene:
    """A hinged and a free body with every kind of shape, turned and off centre, and all kinds of pairs."""
    shapes = (
        Shape("a_ellipse", "a", "ellipse", (0.8, 0.25), offset=(0.2, 0.1), angle=0.7),
        Shape("a_disc", "a", "disc", 0.3, offset=(-0.4, 0.2)),
        Shape("a_plane", "a", "halfplane", offset=(0.1, -0.3), angle=-2.0),
        Shape("b_ellipse", "b", "ellipse", (0.7, 0.5), offset=(0.0, 0.3), angle=-1.1),
        Shape("b_disc", "b", "disc", 0.2, offset=(0.5, 0.0)),
        Shape("b_point", "b", "disc", 0.0, offset=(-0.2, -0.2)),
        Shape("b_plane", "b", "halfplane", angle=0.4),
    )
    pairs = (
        ("a_ellipse", "b_ellipse"), ("b_point", "a_ellipse"), ("a_disc", "b_ellipse"), ("a_disc", "b_disc"),
        ("a_plane", "b_ellipse"), ("a_ellipse", "b_plane"), ("b_point", "a_plane"),
    )  # fmt: skip
    bodies = (
        Body("a", 1.0, 0.2, anchor=(0.3, -0.2), angle=0.3),
        Body("b", 1.5, 0.3, joint="free", com=(0.1, 0.0)),
    )
    return Scene("menagerie", bodies, shapes, tuple(Contact(a, b) for a, b in pairs))


def turned_pair() -> Scene:
    """One frictional pair of turned, off-centre ellipses on free bodies."""
    keep = tuple(s for s in menagerie().shapes if s.name in ("a_ellipse", "b_ellipse"))
    bodies = (Body("a", 1.0, 0.2, joint="free", angle=0.3), Body("b", 1.5, 0.3, joint="free", com=(0.1, 0.0)))
    return Scene("turned_pair", bodies, keep, (Contact("a_ellipse", "b_ellipse", 0.4),))


def moving_plane() -> Scene:
    """A half-plane that turns with its body, under round shapes; friction in both orders of the pair."""
    shapes = (
        Shape("plate", "plate", "halfplane", offset=(0.3, 0.1), angle=1.3),
        Shape("stone", "stone", "ellipse", (0.3, 0.2), offset=(0.05, 0.0), angle=0.5),
        Shape("pebble", "stone", "disc", 0.1, offset=(0.4, 0.0)),
    )
    bodies = (
        Body("plate", 2.0, 0.5, damping=0.3),
        Body("stone", 1.0, 0.1, joint="free", anchor=(0.3, 1.0)),
    )
    contacts = (Contact("plate", "stone", 0.5), Contact("pebble", "plate", 0.3))
    return Scene("moving_plane", bodies, shapes, contacts)


def sprung_plane() -> Scene:
    """`moving_plane` with a joint spring."""
    base = moving_plane()
    plate = dataclasses.replace(base.bodies[0], stiffness=40.0, rest=0.1, armature=0.3)
    return dataclasses.replace(base, name="sprung_plane", bodies=(plate, *base.bodies[1:]))


def capsules() -> Scene:
    """A hinged capsule and a plane against a free capsule; against a disc, with friction: `pill`."""
    shapes = (
        Shape("bar", "arm", "capsule", (0.1, 0.5), offset=(0.5, 0.05), angle=0.2),
        Shape("plate", "arm", "halfplane", offset=(0.0, -0.6), angle=1.3),
        Shape("pill", "pill", "capsule", (0.15, 0.3), offset=(0.05, 0.0), angle=-0.4),
    )
    bodies = (Body("arm", 2.0, 0.5, damping=0.3), Body("pill", 1.0, 0.1, joint="free", anchor=(0.6, 0.45)))
    contacts = (Contact("bar", "pill"), Contact("pill", "plate"))
    return Scene("capsules", bodies, shapes, contacts, step_size=0.02)


def pill() -> Scene:
    """A hinged capsule against a hinged disc: beside its segment and at its ends."""
    shapes = (
        Shape("bar", "arm", "capsule", (0.1, 0.4), offset=(0.5, 0.05), angle=0.2),
        Shape("ball", "mate", "disc", 0.2, offset=(0.5, 0.1)),
    )
    bodies = (Body("arm", 2.0, 0.5, damping=0.3), Body("mate", 1.0, 0.1, anchor=(0.4, 0.45)))
    return Scene("pill", bodies, shapes, (Contact("bar", "ball", 0.4),), step_size=0.02)


def blocks() -> Scene:
    """As `capsules`, of rectangles: a hinged one and a plane against a free one, all corners rounded off."""
    shapes = (
        Shape("bar", "arm", "rectangle", (0.5, 0.1), offset=(0.5, 0.05), angle=0.2, corner_radius=0.04),
        Shape("plate", "arm", "halfplane", offset=(0.0, -0.6), angle=1.3),
        Shape("block", "block", "rectangle", (0.3, 0.2), (0.05, 0.0), -0.4, corner_radius=0.06),
    )
    bodies = (Body("arm", 2.0, 0.5, damping=0.3), Body("block", 1.0, 0.1, joint="free", anchor=(0.6, 0.45)))
    contacts = (Contact("bar", "block"), Contact("block", "plate"))
    return Scene("blocks", bodies, shapes, contacts, step_size=0.02)


def slab() -> Scene:
    """A hinged rectangle with sharp corners against a hinged disc, with friction."""
    shapes = (
        Shape("bar", "arm", "rectangle", (0.4, 0.1), offset=(0.5, 0.05), angle=0.2),
        Shape("ball", "mate", "disc", 0.2, offset=(0.5, 0.1)),
    )
    bodies = (Body("arm", 2.0, 0.5, damping=0.3), Body("mate", 1.0, 0.1, anchor=(0.4, 0.45)))
    return Scene("slab", bodies, shapes, (Contact("ball", "bar", 0.4),), step_size=0.02)


def hoop() -> Scene:
    """A ring on a hinged arm around a free body with a disc, with friction, and a capsule."""
    shapes = (
        Shape("hoop", "arm", "ring", 0.5, offset=(0.5, 0.05), angle=0.2),
        Shape("ball", "mate", "disc", 0.2, offset=(0.2, 0.1)),
        Shape("rod", "mate", "capsule", (0.05, 0.25), offset=(-0.1, 0.0), angle=0.3),
    )
    bodies = (Body("arm", 2.0, 0.5, damping=0.3), Body("mate", 1.0, 0.1, joint="free", anchor=(0.5, 0.05)))
    contacts = (Contact("ball", "hoop", 0.4), Contact("hoop", "rod"))
    return Scene("hoop", bodies, shapes, contacts, step_size=0.02)


def tree(seed: int, *joints: str) -> Scene:
    """A random chain with these joints, or a random tree of four bodies; no contacts."""
    rng = np.random.default_rng(seed)
    return random_tree(rng, len(joints), joints) if joints else random_tree(rng, 4)


def sprung() -> Scene:
    """A chain and a free body with joint springs, tied to each other and to the world by springs, and by a
    tendon that a control pulls; another one is of one coordinate.
    """
    base = random_tree(np.random.default_rng(5), 2, ("prismatic", "revolute"))
    first, second = base.bodies
    bodies = (
        first, dataclasses.replace(second, stiffness=3.0, rest=0.4, armature=0.3),
        Body("stone", 1.0, 0.1, joint="free", anchor=(1.5, 0.5),
             stiffness=(None, 2.0, 0.3), rest=(0.0, 0.2, -0.1), armature=(None, 0.4, 0.05)),
    )  # fmt: skip
    springs = (
        Spring("body1", "stone", (0.4, -0.1), (0.1, 0.2), stiffness=20.0, damping=1.5, length=0.5),
        Spring(None, "body1", (-0.5, 0.8), (0.3, 0.3), stiffness=8.0, damping=0.7),
    )
    tendons = (
        Tendon("rope", ("stone.y", "body0.shift", "body1.angle"), (0.5, 0.7, -0.4), 15.0, 0.8, 0.1),
        Tendon("cuff", ("stone.angle",), (1.5,), 4.0, 0.3, -0.2),
    )
    actuators = (*base.actuators, Actuator(tendon="rope", gear=1.3))
    return dataclasses.replace(
        base, name="sprung", bodies=bodies, springs=springs, tendons=tendons, actuators=actuators
    )


def push_on_ice() -> Scene:
    """`push_block` on a ground without friction: kernels of its own, of four rows."""
    base = scenes.push_block()
    smooth = tuple(dataclasses.replace(contact, friction=None) for contact in base.contacts[:2])
    return dataclasses.replace(base, contacts=(*smooth, base.contacts[2]))


def touching_tree() -> Scene:
    """A random tree with ellipses and a tilted ground: rows that depend on every coordinate."""
    tree = random_tree(np.random.default_rng(11), 2, ("free", "prismatic"), contacts=True)
    return dataclasses.replace(tree, contacts=tree.contacts[:2])  # the two shapes may overlap


MAKERS = {
    **scenes.NAMED,
    "menagerie": menagerie,
    "turned_pair": turned_pair,
    "moving_plane": moving_plane,
    "capsules": capsules,
    "pill": pill,
    "blocks": blocks,
    "slab": slab,
    "hoop": hoop,
    "push_on_ice": push_on_ice,
    "touching_tree": touching_tree,
    "tree0": lambda: tree(0),
    "tree1": lambda: tree(1),
    "sprung": sprung,
    "sprung_plane": sprung_plane,
    "carts": lambda: tree(2, "prismatic", "revolute", "prismatic"),
    "floating": lambda: tree(3, "free", "revolute", "revolute"),
    "rubbing_particle": lambda: scenes.particle(friction=0.5),
    "stack_of_planes": lambda: stack_of_planes(3),
}


def stack_of_planes(count: int) -> Scene:
    """A particle on `count` coincident planes: as many contacts that say the same."""
    base = scenes.particle()
    planes = tuple(Shape(f"ground{i}", None, "halfplane", angle=np.pi / 2) for i in range(count))
    return Scene("stack_of_planes", base.bodies, (base.shapes[0], *planes),
                 tuple(Contact(p.name, "particle") for p in planes))  # fmt: skip


@functools.cache
def scene(name: str) -> Scene:
    """A scene of MAKERS."""
    return MAKERS[name]()


@functools.cache
def simulator(name, device="cpu", dtype=wp.float64, scaling="inertia", residual="rem-logistic"):
    """The Simulator of a scene of MAKERS, compiled at most once."""
    options = slcp.Options(residual=residual, scaling=scaling)
    return slcp.Simulator(scene(name), options, device=device, dtype=WIDTH[dtype])


def rounded(dtype, *arrays):
    """Arrays as the kernel will see them, in float64: the oracle must judge the same numbers."""
    return tuple(np.asarray(a).astype(NUMPY[dtype]).astype(np.float64) for a in arrays)


def numbers(scene, dtype, **changes):
    """The scene's numbers with `changes`, rounded as the kernel will see them, for the oracle."""
    return {k: rounded(dtype, v)[0] for k, v in {**scene.default_parameters(), **changes}.items()}
