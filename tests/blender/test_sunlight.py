"""The share of light that the cross impostor reflects in Cycles."""

from __future__ import annotations

import numpy as np
import pytest
from node_trees import new_image
from scenes import add_mesh

import leafcloud
from addon.levels.material import BACK_NODE, Page, atlas_material
from addon.levels.sunlight import dim_in_cycles, light_share

SQUARE = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def tiers(*heights: float) -> leafcloud.Foliage:
    """White squares of side 2 that face up, one above the other."""
    points = np.concatenate([np.add(SQUARE, (0.0, 0.0, height)) for height in heights])
    faces = np.concatenate([FACES + 4 * number for number in range(len(heights))])
    return leafcloud.Foliage(points.astype(np.float32), faces.astype(np.int32))


def test_a_level_like_the_one_before_is_not_dimmed() -> None:
    crown = tiers(0.0, 0.5)
    assert light_share(crown, crown, crown) == pytest.approx(1.0)


def test_a_level_without_shade_is_dimmed_to_the_shaded_one() -> None:
    """Each of eight near squares is in the shade of the others, but from the sides; a single one never is."""
    crown = tiers(*np.linspace(-0.2, 0.2, 8))
    share = light_share(tiers(0.0), crown, crown)
    assert 0.5 <= share < 0.95
    assert light_share(crown, tiers(0.0), crown) == 1.0, "nothing is made brighter"


@pytest.mark.parametrize("double_sided", [True, False])
def test_opaque_places_are_darker_in_cycles_alone(double_sided: bool) -> None:
    material = atlas_material(
        "cross", Page(new_image("page", [[(0.5, 0.5, 0.5, 1.0)]])), alpha_cutoff=0.5, double_sided=double_sided
    )
    add_mesh("square", SQUARE.tolist(), [(0, 1, 2, 3)], materials=[material])
    dim_in_cycles(material, 0.75)
    tree = material.node_tree
    everywhere, cycles = (tree.get_output_node(name).inputs["Surface"].links[0].from_node for name in ("ALL", "CYCLES"))
    assert everywhere.type == "BSDF_PRINCIPLED"
    if not double_sided:
        assert cycles.name == BACK_NODE
        cycles = cycles.inputs[1].links[0].from_node
    assert cycles.inputs[1].links[0].from_node == everywhere
    shaded = cycles.inputs[0].links[0].from_node
    assert (shaded.operation, shaded.inputs[1].default_value) == ("MULTIPLY", pytest.approx(0.25))
