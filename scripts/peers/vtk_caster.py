"""Runs VTK's fixed-point ray caster (vtkFixedPointVolumeRayCastMapper) on a job that the bench wrote.
Each command is a line on stdin, and each answer a line on stdout.

    view N      renders view N of the job               -> ms
    change      takes the job's other volume            -> ms
    picture P   writes the last picture to the file P   -> ok

Times are of casting alone: the tables that depend on volume and view, and the rays. They include
neither the window system nor the copy of a changed volume. A picture is width * height * 4 numbers
of 16 bits in the machine's order, from the top left: red, green and blue times opacity, and
opacity. 32767 means 1.
"""

import ctypes
import json
import pathlib
import sys
import time

import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  the factories' part of it; no window is opened
import vtkmodules.vtkRenderingVolumeOpenGL2  # noqa: F401
from vtkmodules.vtkCommonCore import VTK_UNSIGNED_CHAR
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkPiecewiseFunction
from vtkmodules.vtkRenderingCore import (
    vtkColorTransferFunction,
    vtkLight,
    vtkRenderer,
    vtkRenderWindow,
    vtkVolume,
    vtkVolumeProperty,
)
from vtkmodules.vtkRenderingVolume import vtkFixedPointVolumeRayCastMapper


class Caster:
    def __init__(self, folder):
        self.job = job = json.loads((folder / "job.json").read_text())
        self.volumes = [(folder / name).read_bytes() for name in job["volumes"]]
        self.shown = 0
        self.image = image = vtkImageData()
        image.SetDimensions(job["dimensions"])
        image.SetSpacing(job["spacing_mm"])
        image.AllocateScalars(VTK_UNSIGNED_CHAR, 1)
        self.voxels = memoryview(image.GetPointData().GetScalars()).cast("B")
        self.show(0)
        self.mapper = mapper = vtkFixedPointVolumeRayCastMapper()
        mapper.SetInputData(image)
        mapper.SetNumberOfThreads(job["threads"])
        # Every pixel has a ray with all samples: slow pictures are not made coarser.
        mapper.AutoAdjustSampleDistancesOff()
        mapper.LockSampleDistanceToInputSpacingOff()
        mapper.SetMinimumImageSampleDistance(1.0)
        mapper.SetMaximumImageSampleDistance(1.0)
        mapper.SetImageSampleDistance(1.0)
        mapper.SetSampleDistance(job["step_mm"])
        mapper.SetInteractiveSampleDistance(job["step_mm"])
        mapper.IntermixIntersectingGeometryOff()
        self.volume = vtkVolume()
        self.volume.SetMapper(mapper)
        self.volume.SetProperty(self.classification(job))
        self.light = vtkLight()
        self.light.SetLightTypeToSceneLight()
        # The default is black, which would remove the ambient part.
        self.light.SetAmbientColor(1.0, 1.0, 1.0)
        self.renderer = renderer = vtkRenderer()
        renderer.AutomaticLightCreationOff()
        renderer.AddLight(self.light)
        renderer.AddVolume(self.volume)
        # Only its size is used; nothing is drawn to it.
        self.window = vtkRenderWindow()
        self.window.SetOffScreenRendering(1)
        self.window.SetSize(job["size"])
        self.window.AddRenderer(renderer)
        self.camera = renderer.GetActiveCamera()
        self.camera.ParallelProjectionOn()

    @staticmethod
    def classification(job):
        opacity, colour = vtkPiecewiseFunction(), vtkColorTransferFunction()
        for value, alpha in job["opacity"]:
            opacity.AddPoint(value, alpha)
        for value, grey in job["grey"]:
            colour.AddRGBPoint(value, grey, grey, grey)
        made = vtkVolumeProperty()
        made.SetScalarOpacity(opacity)
        made.SetScalarOpacityUnitDistance(job["unit_mm"])
        made.SetColor(colour)
        made.SetInterpolationTypeToLinear()
        light = job["light"]
        if light is not None:
            made.ShadeOn()
            made.SetAmbient(light["ambient"])
            made.SetDiffuse(light["diffuse"])
            made.SetSpecular(light["specular"])
            made.SetSpecularPower(light["shininess"])
        return made

    def show(self, which):
        self.shown = which
        self.voxels[:] = self.volumes[which]
        self.image.GetPointData().GetScalars().Modified()
        self.image.Modified()

    def look(self, view):
        self.camera.SetFocalPoint(view["centre"])
        self.camera.SetPosition(view["eye"])
        self.camera.SetViewUp(view["up"])
        self.camera.SetParallelScale(view["half_height_mm"])
        self.renderer.ResetCameraClippingRange()
        # A headlight.
        self.light.SetPosition(view["eye"])
        self.light.SetFocalPoint(view["centre"])

    def cast(self):
        began = time.perf_counter()
        self.mapper.PerVolumeInitialization(self.renderer, self.volume)
        self.mapper.PerImageInitialization(self.renderer, self.volume, 0, [0.0] * 3, [0.0] * 3, [0, 0, 0])
        self.mapper.PerSubVolumeInitialization(self.renderer, self.volume, 0)
        self.mapper.RenderSubVolume()
        return 1e3 * (time.perf_counter() - began)

    def picture(self):
        held = self.mapper.GetRayCastImage()
        # VTK's wrapper returns the address of the pixels as text.
        address = int(held.GetImage().split("_")[1], 16)
        (row, rows), (wide, high), (left, bottom) = held.GetImageMemorySize(), held.GetImageInUseSize(), held.GetImageOrigin()
        pixels = ctypes.string_at(address, row * rows * 8)
        width, height = self.job["size"]
        whole = bytearray(width * height * 8)
        for y in range(high):
            # The first row is the lowest.
            to = ((height - 1 - bottom - y) * width + left) * 8
            whole[to : to + wide * 8] = pixels[y * row * 8 : (y * row + wide) * 8]
        return whole

    def answer(self, command, *of):
        if command == "view":
            self.look(self.job["views"][int(of[0])])
            return self.cast()
        if command == "change":
            self.show(1 - self.shown)
            return self.cast()
        if command == "picture":
            pathlib.Path(of[0]).write_bytes(self.picture())
            return "ok"
        raise SystemExit(f"no command is called {command}")


def main():
    caster = Caster(pathlib.Path(sys.argv[1]))
    print("ready", flush=True)
    for line in sys.stdin:
        print(caster.answer(*line.strip().split(maxsplit=1)), flush=True)


if __name__ == "__main__":
    main()
