"""Writes the STEP files of tests/step with OpenCascade, which shares nothing with the reader under test.

    pip install cadquery && python3 benches/step_samples.py tests/step

Prints volume and area of each solid by OpenCascade's own integration, which the tests state.
"""

import re
import sys
from pathlib import Path

import cadquery as cq
from OCP.BRepGProp import BRepGProp
from OCP.GProp import GProp_GProps
from OCP.Interface import Interface_Static
from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer


def written(folder, name, shape, schema, unit="MM"):
    writer = STEPControl_Writer()  # first: it makes the settings
    Interface_Static.SetCVal_s("write.step.schema", schema)
    Interface_Static.SetCVal_s("write.step.unit", unit)
    Interface_Static.SetCVal_s("write.step.product.name", name)
    # Without the curves in the parameters of the surfaces, which repeat those in space.
    Interface_Static.SetIVal_s("write.surfacecurve.mode", 0)
    writer.Transfer(shape.wrapped, STEPControl_AsIs)
    path = folder / f"{name}.step"
    writer.Write(str(path))
    dated(path)
    told(name, shape)


def dated(path):
    """The date of writing is left out, so that the same program gives the same file."""
    path.write_text(re.sub(r"'\d{4}-\d\d-\d\dT[\d:]+'", "''", path.read_text(), count=1))


def told(name, shape):
    volume, area = GProp_GProps(), GProp_GProps()
    BRepGProp.VolumeProperties_s(shape.wrapped, volume)
    BRepGProp.SurfaceProperties_s(shape.wrapped, area)
    box = shape.BoundingBox()
    print(f"{name}: volume {volume.Mass():.9f} mm3, area {area.Mass():.9f} mm2, "
          f"box {box.xmin:.6f} {box.ymin:.6f} {box.zmin:.6f} {box.xmax:.6f} {box.ymax:.6f} {box.zmax:.6f}")


def plate():
    """A plate with a step, two bores, a countersink, a pocket, and rounded corners."""
    part = cq.Workplane("XY").box(80, 60, 12, centered=(True, True, False)).edges("|Z").fillet(6)
    part = part.faces(">Z").workplane().center(0, 0).pushPoints([(-25, -15), (25, 15)]).hole(12)
    part = part.faces(">Z").workplane(origin=(25, -15, 12)).cskHole(8, 16, 90)
    part = part.faces(">Z").workplane(origin=(-22, 14, 12)).rect(20, 16).cutBlind(-4)
    return part.union(cq.Workplane("XY").box(20, 20, 20, centered=(True, True, False))).val()


def turned():
    """A turned part: shaft, cone, groove with a round bottom, ball end."""
    outline = (
        cq.Workplane("XZ").moveTo(0, 0).lineTo(15, 0).lineTo(15, 20)
        .threePointArc((12, 23), (15, 26)).lineTo(15, 36).lineTo(8, 50).lineTo(8, 58)
        .threePointArc((8 * 0.7071067811865476, 58 + 8 * 0.7071067811865476), (0, 66)).close()
    )
    return outline.revolve(360, (0, 0, 0), (0, 1, 0)).val()


def loft():
    """A part with freeform faces."""
    return (cq.Workplane("XY").rect(30, 20).workplane(offset=25).ellipse(9, 6).loft(ruled=False)).val()


def swept():
    """A part with freeform faces of every kind: a spline that is moved, one that is turned, an ellipse moved, a loft."""
    around = [(20, 0), (12, 14), (-6, 16), (-19, 5), (-15, -12), (4, -17)]
    base = cq.Workplane("XY").spline(around, periodic=True).close().extrude(10)
    base = base.cut(cq.Workplane("XY").ellipse(7, 4).extrude(10))
    outline = cq.Workplane("XZ").moveTo(11, 10).lineTo(18, 10).spline([(19, 16), (15, 22), (16, 30)], includeCurrent=True)
    ring = outline.lineTo(11, 30).close().revolve(360, (0, 0, 0), (0, 1, 0))
    boss = cq.Workplane("XY", origin=(0, 0, -12)).rect(12, 10).workplane(offset=12).circle(8.5).loft()
    return base.union(ring).union(boss).val()


def assembly(folder):
    """Two pins in a plate, in inches, each pin placed by the assembly."""
    plate = cq.Workplane("XY").box(50.8, 25.4, 6.35, centered=(True, True, False))
    plate = plate.faces(">Z").workplane().pushPoints([(-12.7, 0), (12.7, 0)]).hole(6.35)
    pin = cq.Workplane("XY").circle(3.175).extrude(19.05)
    whole = cq.Assembly(name="inches")
    whole.add(plate, name="plate")
    whole.add(pin, name="pin1", loc=cq.Location((-12.7, 0, 6.35)))
    whole.add(pin, name="pin2", loc=cq.Location((12.7, 0, 31.75), (1, 0, 0), 180))
    Interface_Static.SetCVal_s("write.step.schema", "AP214IS")
    Interface_Static.SetCVal_s("write.step.unit", "INCH")
    path = folder / "inches.step"
    whole.export(str(path))
    dated(path)
    told("inches", whole.toCompound())


def main():
    folder = Path(sys.argv[1])
    written(folder, "plate", plate(), "AP242DIS")
    written(folder, "turned", turned(), "AP203")
    written(folder, "loft", loft(), "AP214IS")
    written(folder, "swept", swept(), "AP242DIS")
    assembly(folder)


main()
