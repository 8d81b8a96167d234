"""A study in ParaView: the deformed sheet coloured by shear angle, its yarns as lines, its tools,
at the last state.

    pvpython studies/paraview/show.py results/double_dome --picture formed.png

writes a picture (with xvfb-run where there is no screen). In ParaView's window, Macros > Import New
Macro... takes this file: open the fields.pvd of a study, and the macro shows that study. View >
Python Shell > Run Script with this file does the same, after which show("results/double_dome")
shows another. For ParaView 5.11 and later; needs nothing else of this project.
"""

import argparse
import math
import os
import sys

PIXELS = [1600, 1000]
YARNS = 40  # about, across the longer side
TOOL_COLOUR = (0.55, 0.58, 0.62)
YARN_COLOUR = (0.15, 0.16, 0.18)


def show(folder=None, picture=None, spacing=None):
    """Show the results in `folder`, by default those of the active source; picture: a PNG to write;
    spacing: between the lines [mm], by default a round one. Returns the view. Raises ValueError
    where there are none."""
    folder = _of_active_source() if folder is None else str(folder)
    path = os.path.join(folder, "fields.pvd")
    if not os.path.isfile(path):
        raise ValueError(
            f"{path} is not there; allowed is the --out folder of a study that has written a state"
        )
    if spacing is not None and not spacing > 0:
        raise ValueError(f"spacing is {spacing:g}; allowed is a number above 0")
    if picture and not os.path.isdir(os.path.dirname(os.path.abspath(picture))):
        raise ValueError(f"{picture} can't be written; allowed is a file in a folder that is there")
    import paraview.simple as pv

    pv._DisableFirstRenderCameraReset()
    view = pv.CreateView("RenderView") if pv.GetActiveView() is None else pv.GetActiveView()
    if picture:
        view.ViewSize = PIXELS
    for source in pv.GetSources().values():
        pv.Hide(source, view)

    sheet = _sheet(pv, view, path)
    _yarns(pv, view, sheet, spacing, 3 if picture else 2)
    _look(pv, sheet, view)  # at the sheet, before there are tools
    path = os.path.join(folder, "tools.pvd")
    if os.path.isfile(path):
        tools = pv.Show(pv.PVDReader(registrationName="tools", FileName=path), view)
        tools.ColorArrayName = ["POINTS", ""]
        tools.AmbientColor = tools.DiffuseColor = TOOL_COLOUR
        tools.Opacity = 0.3

    pv.SetActiveSource(sheet)
    pv.Render(view)
    if picture:
        pv.SaveScreenshot(str(picture), view, ImageResolution=PIXELS)
    return view


def _sheet(pv, view, path):
    """The sheet of the last state in the file `path`, deformed and coloured."""
    fields = pv.PVDReader(registrationName="fields", FileName=path)
    time = list(fields.TimestepValues)[-1]
    scene = pv.GetAnimationScene()
    scene.UpdateAnimationUsingDataTimeSteps()
    scene.AnimationTime = view.ViewTime = time
    vectors = ["POINTS", "u_mm"]
    sheet = pv.WarpByVector(registrationName="deformed", Input=fields, Vectors=vectors)
    sheet.UpdatePipeline(time)
    display = pv.Show(sheet, view)
    display.SetRepresentationType("Surface")
    display.NonlinearSubdivisionLevel = 3
    display.Ambient, display.Diffuse = 0.3, 0.75
    _colour(pv, sheet, display, view)
    return sheet


def _yarns(pv, view, sheet, spacing, width):
    """Lines of this width along the yarns, `spacing` [mm] apart, None for a round one."""
    spacing = spacing or _round(max(_span(sheet, f"yarn_coordinate_{k}_mm") for k in "ab") / YARNS)
    for k in "ab":
        name = f"yarn_coordinate_{k}_mm"
        low, high = sheet.PointData[name].GetRange()
        # between multiples of the spacing, so that none runs along an edge, where rounding has it
        # come and go
        first, last = math.ceil(low / spacing - 0.5), math.floor(high / spacing - 0.5)
        values = [spacing * (n + 0.5) for n in range(first, last + 1)]
        lines = pv.Contour(
            registrationName=f"yarns {k}",
            Input=sheet,
            ContourBy=["POINTS", name],
            Isosurfaces=values,
            ComputeNormals=0,
            ComputeScalars=0,
        )
        drawn = pv.Show(lines, view)
        drawn.ColorArrayName = ["POINTS", ""]
        drawn.AmbientColor = drawn.DiffuseColor = YARN_COLOUR
        drawn.LineWidth = width


def _of_active_source():
    import paraview.simple as pv

    source = pv.GetActiveSource()
    while hasattr(source, "Input"):
        source = source.Input
    return os.path.dirname(str(getattr(source, "FileName", "")))


def _span(source, name):
    low, high = source.PointData[name].GetRange()
    return high - low


def _round(value):
    """The 1, 2 or 5 times a power of ten that is next below or at `value`."""
    power = 10.0 ** math.floor(math.log10(value))
    return max(k for k in (1, 2, 5) if k * power <= value) * power


def _colour(pv, sheet, display, view):
    """By shear angle, white at 0, with a bar that says so."""
    pv.ColorBy(display, ("CELLS", "shear_angle_deg"))
    largest = max(0.1, *map(abs, sheet.CellData["shear_angle_deg"].GetRange()))
    largest = _round(largest) * math.ceil(largest / _round(largest))
    colours = pv.GetColorTransferFunction("shear_angle_deg")
    colours.ApplyPreset("Cool to Warm", True)
    colours.AutomaticRescaleRangeMode = "Never"
    colours.RescaleTransferFunction(-largest, largest)
    bar = pv.GetScalarBar(colours, view)
    bar.Title, bar.ComponentTitle = "shear angle / deg", ""
    bar.Orientation, bar.WindowLocation, bar.ScalarBarLength = "Horizontal", "Lower Center", 0.4
    bar.AutomaticLabelFormat, bar.LabelFormat, bar.RangeLabelFormat = 0, "%g", "%g"
    bar.TitleColor = bar.LabelColor = (0, 0, 0)
    bar.TitleFontSize, bar.LabelFontSize = 22, 20
    display.SetScalarBarVisibility(view, True)
    view.UseColorPaletteForBackground = 0
    view.Background = (1, 1, 1)
    view.OrientationAxesLabelColor = (0, 0, 0)


def _look(pv, sheet, view):
    """From above on a sheet that stayed plane, at a slant on others."""
    low_x, high_x, low_y, high_y, low_z, high_z = sheet.GetDataInformation().GetBounds()
    centre = [(low_x + high_x) / 2, (low_y + high_y) / 2, (low_z + high_z) / 2]
    size = max(high_x - low_x, high_y - low_y, high_z - low_z)
    plane = high_z - low_z < 1e-6 * size
    direction, up = ((0, 0, 1), (0, 1, 0)) if plane else ((0.7, 1.0, 0.9), (0, 0, 1))
    view.CameraFocalPoint = centre
    view.CameraPosition = [c + size * d for c, d in zip(centre, direction)]
    view.CameraViewUp = up
    view.CameraParallelProjection = 1
    pv.ResetCamera(view)
    view.CameraParallelScale *= (
        0.75 if plane else 0.9
    )  # which leaves room for a ball about the sheet


def main():
    p = argparse.ArgumentParser(prog="show.py", description=__doc__.splitlines()[0])
    p.add_argument("folder", metavar="DIR", help="results of a study")
    p.add_argument("--picture", metavar="PNG", help="write a picture")
    p.add_argument("--spacing", type=float, metavar="MM", help="between the yarns drawn")
    inside = not sys.argv[0]  # ParaView itself, where exiting would close it
    try:
        show(**({} if inside else vars(p.parse_args())))
    except (ValueError, ImportError) as error:
        lacking = (
            isinstance(error, ImportError) and "this Python has no ParaView; allowed is pvpython"
        )
        print(f"show.py: error: {lacking or error}", file=sys.stderr)
        if not inside:
            sys.exit(2)


if __name__ in ("__main__", "__vtkconsole__"):
    main()
