"""A study in ParaView: the deformed sheet coloured by shear angle, its yarns as lines, its tools,
at the last state.

    pvpython studies/paraview/show.py results/double_dome --picture formed.png

writes a picture (with xvfb-run where there is no screen). In ParaView's Python shell
show("results/double_dome") does it after View > Python Shell > Run Script with this file.
"""

import argparse
import os
import sys


def show(folder, picture=None, spacing=20.0):
    """Show the results in `folder`; picture: a PNG to write; spacing: between lines [mm]."""
    import paraview.simple as pv

    view = pv.GetActiveViewOrCreate("RenderView")
    fields = pv.PVDReader(FileName=os.path.join(folder, "fields.pvd"))
    scene = pv.GetAnimationScene()
    scene.UpdateAnimationUsingDataTimeSteps()
    scene.AnimationTime = view.ViewTime = list(fields.TimestepValues)[-1]
    sheet = pv.WarpByVector(Input=fields, Vectors=["POINTS", "u_mm"])
    sheet.UpdatePipeline(view.ViewTime)
    display = pv.Show(sheet, view)
    pv.ColorBy(display, ("CELLS", "shear_angle_deg"))
    largest = max(1.0, *map(abs, sheet.CellData["shear_angle_deg"].GetRange()))
    pv.GetColorTransferFunction("shear_angle_deg").RescaleTransferFunction(-largest, largest)
    display.SetScalarBarVisibility(view, True)
    for name in ("yarn_coordinate_a_mm", "yarn_coordinate_b_mm"):
        low, high = (int(end // spacing) for end in sheet.PointData[name].GetRange())
        # not at multiples, so that none runs along an edge
        values = [spacing * (n + 0.5) for n in range(low, high + 1)]
        lines = pv.Contour(Input=sheet, ContourBy=["POINTS", name], Isosurfaces=values)
        pv.ColorBy(pv.Show(lines, view), None)
    tools = os.path.join(folder, "tools.pvd")
    if os.path.isfile(tools):
        pv.Show(pv.PVDReader(FileName=tools), view).Opacity = 0.3
    view.CameraPosition, view.CameraViewUp = (0.7, 1.0, 0.9), (0, 0, 1)
    view.CameraFocalPoint = (0, 0, 0)
    pv.ResetCamera(view)
    pv.Render(view)
    if picture:
        pv.SaveScreenshot(picture, view, ImageResolution=[1600, 1000])


if __name__ == "__main__" and sys.argv[0]:  # empty in ParaView's own shell
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", help="results of a study")
    parser.add_argument("--picture", metavar="PNG", help="write a picture")
    parser.add_argument("--spacing", type=float, default=20.0, help="between yarns [mm]")
    args = parser.parse_args()
    if not os.path.isfile(os.path.join(args.folder, "fields.pvd")):
        parser.error(f"{args.folder}/fields.pvd does not exist; expected the --out of a study")
    show(**vars(args))
