"""Reads meshes of sonoweave with VTK, trimesh and meshio: the same triangles, closed, with the
volume that sonoweave says.

Usage: meshes.py SONOWEAVE FOLDER. Writes into the empty folder, and ends with an error at the
first difference.
"""

import json
import subprocess
import sys
from pathlib import Path

import meshio
import nrrd
import numpy as np
import trimesh
from vtkmodules.vtkCommonCore import vtkVersion
from vtkmodules.vtkFiltersCore import vtkMassProperties
from vtkmodules.vtkIOGeometry import vtkOBJReader, vtkSTLReader
from vtkmodules.vtkIOPLY import vtkPLYReader

SONOWEAVE, FOLDER = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
RADII = (11.0, 8.0, 6.0)
checks = 0


def check(is_right, what):
    global checks
    checks += 1
    if not is_right:
        sys.exit(f"meshes: {what}")


def near(a, b, share=1e-5):
    return abs(a / b - 1) < share


# An ellipsoid that is bright inside.
z, y, x = np.meshgrid(*[np.arange(n) * 0.5 for n in (40, 48, 60)], indexing="ij")
inside = 1 - np.sqrt(sum(((a - m) / r) ** 2 for a, m, r in zip((x, y, z), (15.1, 12.2, 10.3), RADII)))
values = np.clip(128 + 300 * inside, 0, 255).astype("uint8")
nrrd.write(str(FOLDER / "v.nrrd"), values.T, {"space": "left-posterior-superior", "space directions": np.eye(3) * 0.5, "space origin": [1, 2, 3]})
reports = {}
for kind in ("stl", "ply", "obj", "glb"):
    words = ["surface", "v.nrrd", "-o", f"m.{kind}", "--isovalue", "128", f"--json={kind}.json"]
    run = subprocess.run([str(SONOWEAVE), *words], cwd=FOLDER, capture_output=True, text=True)
    check(run.returncode == 0, f"sonoweave {' '.join(words)}: {run.stderr}")
    reports[kind] = json.loads((FOLDER / f"{kind}.json").read_text())
said = reports["stl"]
ellipsoid = 4 / 3 * np.pi * np.prod(RADII)
check(near(said["volume_mm3"], ellipsoid, 0.01), f"{said['volume_mm3']} mm³ for {ellipsoid}")

points = []
for kind in reports:
    # glTF is in metres.
    scale = 1000 if kind == "glb" else 1
    mesh = trimesh.load(FOLDER / f"m.{kind}", force="mesh", process=True)
    check(len(mesh.faces) == said["triangles"], f"trimesh finds {len(mesh.faces)} triangles in m.{kind}")
    check(mesh.is_watertight and mesh.is_winding_consistent, f"m.{kind} is not closed for trimesh")
    check(mesh.euler_number == 2, f"m.{kind} has the Euler number {mesh.euler_number}")
    check(near(mesh.volume * scale**3, said["volume_mm3"]), f"trimesh: {mesh.volume} for m.{kind}")
    check(near(mesh.area * scale**2, said["area_mm2"]), f"trimesh: {mesh.area} for m.{kind}")
    points.append(np.sort(mesh.bounds.ravel() * scale))
check(all(np.allclose(one, points[0], atol=1e-4) for one in points), "the files lie at different places")

for kind in ("stl", "ply", "obj"):
    mesh = meshio.read(FOLDER / f"m.{kind}")
    faces = mesh.cells_dict["triangle"]
    check(len(faces) == said["triangles"], f"meshio finds {len(faces)} triangles in m.{kind}")
    a, b, c = (mesh.points[faces[:, n]].astype(float) for n in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    check(near(volume, said["volume_mm3"]), f"meshio: {volume} mm³ for m.{kind}")

for kind, reader in (("stl", vtkSTLReader()), ("ply", vtkPLYReader()), ("obj", vtkOBJReader())):
    reader.SetFileName(str(FOLDER / f"m.{kind}"))
    reader.Update()
    check(reader.GetOutput().GetNumberOfCells() == said["triangles"], f"VTK finds other triangles in m.{kind}")
    measures = vtkMassProperties()
    measures.SetInputConnection(reader.GetOutputPort())
    measures.Update()
    check(near(measures.GetVolume(), said["volume_mm3"], 1e-3), f"VTK: {measures.GetVolume()} mm³ for m.{kind}")
    check(near(measures.GetSurfaceArea(), said["area_mm2"]), f"VTK: {measures.GetSurfaceArea()} mm² for m.{kind}")

names = f"trimesh {trimesh.__version__}, meshio {meshio.__version__} and VTK {vtkVersion.GetVTKVersion()}"
print(f"meshes: {checks} checks with {names} passed")
