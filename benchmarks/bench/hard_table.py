"""The hard cases, with the iterations that each took when it was measured."""

from . import hard_sheets as sheets
from . import hard_strips as strips
from .hard import Case

ALL = (
    Case("bias 45 %", strips.bias_to_45_percent, 115, quick=True),
    Case("p_min 0 to 1", strips.tension_compression, 747, snaps=True),
    Case("E_C 0.13 MPa", strips.squeezed_strip(0.13), 783, snaps=True, stops=0.6),
    Case("E_C 1.3 MPa", strips.squeezed_strip(1.3), 540, snaps=True, stops=0.9),
    Case("E_C 130 MPa", strips.squeezed_strip(130.0), 571),
    Case("s_C 10", strips.compression_and_shear(10.0), 353),
    Case("s_C 100", strips.compression_and_shear(100.0), 270, snaps=True, stops=0.6),
    Case("s_C 1000", strips.compression_and_shear(1000.0), 510, snaps=True, stops=0.5),
    Case("picture frame 70 deg", strips.picture_frame, 132, quick=True),
    Case("single elements", strips.single_elements, 0, quick=True),
    Case("scales, 0.001 to 20 mm", strips.scales, 252, quick=True),
    Case("slack net", sheets.slack_net, 50, quick=True),
    Case("strip that snaps", sheets.strip_that_snaps, 224, snaps=True),
    Case("dome that snaps", sheets.dome_that_snaps, 366, snaps=True),
    Case("wrinkles in shear", sheets.wrinkles_in_shear, 130, quick=True),
    Case("pulled out", sheets.pulled_out, 8, quick=True),
    Case("sharp bar", sheets.sharp_bar, 101, quick=True),
    Case("ball of triangles", sheets.ball_of_triangles, 88),
    Case("ball by force", sheets.ball_by_force, 88),
    Case("matched die", sheets.matched_die, 374),
    Case("dome without friction", sheets.dome_without_friction, 433),
    Case("two plies", sheets.plies("P1", 45, 0), 94),
    Case("three plies", sheets.plies("P1", 0, 45, 0), 82),
    Case("mixed order", sheets.plies("P2", 45, 0), 80),
    Case("steel to 30 %", sheets.steel_at_30_percent, 22, quick=True),
    Case("steel that buckles", sheets.steel_that_buckles, 89),
    Case("half turn", sheets.half_turn, 159, quick=True),
)
CASES = {case.name: case for case in ALL}
