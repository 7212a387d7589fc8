"""The page that says which parts make which classical system, and where it is shown: names checked, numbers those of the scripts when the pages were made."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tools.catalogue import catalogue
from tools.gallery import EXAMPLES, Machine

TESTS = EXAMPLES.parent / "tests"
_WORDS = (
    "The classical systems of engineering dynamics, each from parts of the catalogue alone: no equation is written by hand for a scene. States and operations are "
    "those of the model that the page of the gallery builds; its error is what the script found against a closed form, a reference or what stays constant, when these "
    "pages were made. Tests compare more of each, for many values; the number behind them is the largest difference that they allow."
)


@dataclass(frozen=True)
class Row:
    """A system, with names of scripts in `examples` and of tests, "file::function", that show it."""

    system: str
    examples: tuple[str, ...]
    tests: tuple[str, ...] = ()


ROWS = (
    Row("particle in Cartesian, cylindrical, spherical and other coordinates", ("kepler_orbit",), ("systems::a_free_particle_is_told_in_cylindrical_and_spherical_coordinates", "systems::coordinates_do_not_end_a_motion_through_the_axis")),
    Row("particle under uniform and central gravity", ("kepler_orbit",), ("fields::an_orbit_closes",)),
    Row("particle on a rough surface, with friction that sticks", ("rough_slope",), ()),
    Row("particle on a spinning cone", ("spinning_cone",), ("systems::a_bead_in_a_groove_of_a_spinning_cone_is_thrown_out",)),
    Row("constraint that is imposed suddenly", ("caught_rod",), ()),
    Row("roller coaster, also off the track and off its end", ("roller_coaster", "ski_jump"), ("guides::a_car_passes_a_looping",)),
    Row("particle on a sphere and on surfaces of revolution", ("conical_pendulum",), ("guides::a_particle_passes_both_poles_of_a_sphere", "guides::a_particle_circles_in_a_cone")),
    Row("particle on a helix", ("helix",), ("guides::a_bead_on_a_helix_falls_at_constant_rate",)),
    Row("particle on a rotating hoop", ("rotating_hoop",), ("guides::a_bead_on_a_hoop_that_turns_stands_where_gravity_and_turning_agree",)),
    Row("row of oscillators and its modes", ("oscillators",), ("closed_forms::a_row_of_oscillators_plucked_at_rest_is_the_sum_of_its_modes",)),
    Row("dumbbell satellite", ("dumbbell_satellite",), ("fields::a_dumbbell_of_two_particles_feels_the_gradient_by_itself",)),
    Row("pendulum on a cart", ("cart_swing_up",), ("lagrange::cart_with_a_spring_and_a_pendulum", "linearize::a_pendulum_on_a_cart_has_the_textbook_matrices")),
    Row("particles on a string that is taut or slack", ("string_pendulum",), ("systems::a_weight_under_a_table_draws_a_puck_towards_its_hole",)),
    Row("rotations: Euler angles, quaternions, Rodrigues' vectors, joint coordinates", ("attitudes",), ("rotations::euler_angles_are_what_scipy_calls_so_both_ways", "rotations::a_knee_bends_as_grood_and_suntay_say")),
    Row("attitude at a given angular velocity", ("attitudes",), ("systems::a_frame_is_turned_as_told_by_angles_samples_and_angular_velocities",)),
    Row("constrained bodies, integrability of constraints", ("skate_on_slope",), ("integrability::growth_vectors_are_those_of_the_textbooks", "integrability::bodies_that_roll_on_a_plane_are_nonholonomic")),
    Row("springs, gravity and its gradient on bodies", ("satellite",), ("fields::the_gradient_turns_a_satellite_as_its_points_of_mass_say", "closed_forms::stiff_spring_pendulum")),
    Row("free rotation, also about the middle axis", ("dzhanibekov",), ("closed_forms::symmetric_free_body_precesses_as_euler_found", "closed_forms::free_body_flips_about_its_middle_axis")),
    Row("baseball, football", ("baseball", "football"), ("systems::a_baseball_that_spins_flies_as_a_linear_law_says",)),
    Row("tops: Lagrange's, sleeping, Poisson's on smooth ground", ("lagrange_top", "poisson_top", "gyroscopic"), ("closed_forms::heavy_top", "systems::a_top_on_ice_nods_as_its_energy_says")),
    Row("spheres that slide and roll, on planes and in bowls", ("bowling_ball", "ball_on_turntable", "ball_in_cylinder"), ("guides::a_ball_rolls_in_a_bowl_as_a_longer_pendulum", "touching::a_ball_runs_down_a_ball_as_a_pendulum_upside_down")),
    Row("Chaplygin's sphere", ("chaplygin_sphere",), ("touching::chaplygins_ball_keeps_its_angular_momentum_about_the_point_that_touches",)),
    Row("satellite in gravity's gradient", ("satellite",), ("fields::a_satellite_swings_about_the_vertical", "systems::roll_and_yaw_of_a_satellite_are_coupled_by_its_orbit")),
    Row("disks that roll and slide, also nearly flat", ("rolling_disk", "eulers_disk"), ("closed_forms::disk_rolls_in_a_steady_circle", "contact_laws::a_disk_rolls_on_its_edge_as_eulers_disk_does", "touching::a_disk_rolls_steadily_around_in_a_cone_at_any_lean")),
    Row("planar double pendulum", ("double_pendulum",), ("lagrange::planar_double_pendulum",)),
    Row("double pendulum on ball joints", ("ball_jointed_pendulum",), ()),
    Row("dual-spin satellite", ("dual_spin",), ("systems::a_dual_spin_satellite_moves_as_a_gyrostat",)),
    Row("simple car", ("car_in_a_circle",), ("systems::a_single_track_car_drives_in_a_circle",)),
    Row("whirling rotor", ("whirling_rotor",), ("systems::an_unbalanced_rotor_whirls",)),
    Row("universal joint", ("universal_joint",), ()),
    Row("rattleback", ("rattleback",), ("closed_forms::rattleback_reverses_its_spin", "touching::an_ellipsoid_on_a_plane_rolls_as_the_rattleback_does")),
    Row("body that bounces", ("ball_down_the_stairs",), ("toys::a_rocking_block_loses_housners_share_at_each_impact_and_stands",)),
    Row("navigation equations", ("navigation",), ("systems::navigation_equations_follow_an_aircraft", "systems::an_accelerometer_feels_what_is_not_gravity")),
    Row("slider-crank, rigid and elastic", ("engine", "flexible_slider_crank", "slider_crank_cycle"), ()),
    Row("four-bar, and nets of them", ("four_bar",), ()),
    Row("Andrews' squeezing mechanism", ("andrews",), ()),
    Row("Bennett's and Bricard's linkages", ("bennett", "bricard"), ("formulations::linkages_with_more_mobility_than_a_count_of_freedoms_gives",)),
    Row("flyball governor", ("governor",), ()),
    Row("Whipple's bicycle", ("bicycle", "braking"), ()),
    Row("tippe top", ("tippe_top",), ("toys::a_tippe_top_slips_and_turns_over_as_its_own_equations_say",)),
    Row("serial arm with its drives", ("robot_r3", "robot_arm"), ("robot_r3::motor_follows_its_current_as_a_lag_of_second_order",)),
    Row("geared motor with its circuit", ("robot_r3",), ("electrical::motor_with_gear_moves_an_arm", "systems::a_motor_reaches_the_speed_that_its_losses_allow")),
    Row("chain of links", ("hanging_chain",), ("hard_cases::chain_of_50_runs_backwards", "reduction::aligned_chains_take_at_most_300_operations_a_link")),
)  # fmt: skip


def write_page(page: Path, machines: Sequence[Machine]) -> None:
    """Write the page, with the numbers of scripts that ran."""
    ran = {machine.name: machine for machine in machines}
    lines = [
        "# Systems: which parts make them",
        "",
        _WORDS,
        "",
        "| system | parts | states, operations | shown on | its error | tests, and what they allow |",
    ]
    lines += ["|---|---|---|---|---|---|", *(_line(row, ran) for row in ROWS), ""]
    page.write_text("\n".join(lines), encoding="utf-8")


def script_of(name: str) -> Path:
    """An example's script. Raises `LookupError` where there is none, or more than one."""
    found = list(EXAMPLES.rglob(f"{name}.py"))
    if len(found) != 1:
        raise LookupError(f"examples/**/{name}.py: {len(found)} files.")
    return found[0]


def function_of(test: str) -> ast.FunctionDef:
    """The source of a test "file::function". Raises `LookupError` where there is none."""
    file, _, name = test.partition("::")
    tree = ast.parse((TESTS / f"test_{file}.py").read_text(encoding="utf-8"))
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and node.name == f"test_{name}":
            return node
    raise LookupError(f"tests/test_{file}.py has no test_{name}.")


def _line(row: Row, ran: dict[str, Machine]) -> str:
    machines = [ran[name] for name in row.examples]
    trees: list[ast.AST] = [ast.parse(m.script.read_text(encoding="utf-8")) for m in machines] or [*map(function_of, row.tests)]
    cells = (
        row.system,
        ", ".join(f"[{name}](parts/{name}.md)" for name in _parts(trees)),
        "<br>".join(_size(m.printed) for m in machines),
        "<br>".join(f"[{m.name.replace('_', ' ')}](gallery/{m.name}.md)" for m in machines),
        "<br>".join(f"{m.error:.0e}" for m in machines),
        "<br>".join(f"{test.partition('::')[2].replace('_', ' ')}{_allowed(test)}" for test in row.tests),
    )
    return f"| {' | '.join(cells)} |"


def _parts(trees: Iterable[ast.AST]) -> list[str]:
    """What of the catalogue code names, in alphabetical order."""
    named = {node.id for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Name)}
    return sorted(named & {kind.name for kind in catalogue()} - {"World"})


def _size(printed: str) -> str:
    found = re.search(r"(\d+) states?\b.*?(\d+) operations", printed)
    return f"{found[1]}, {found[2]}" if found else "-"


def _allowed(test: str) -> str:
    """The largest number of a test that is smaller than a thousandth."""
    source = ast.unparse(function_of(test))
    found = [float(number) for number in re.findall(r"\b\d+(?:\.\d+)?e-\d+", source.partition("assert")[2])]
    small = [number for number in found if number < 1e-3]
    return f": {max(small):.0e}" if small else ""
