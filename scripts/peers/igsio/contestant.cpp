// Inserts the frames of a scan by IGSIO's vtkIGSIOPasteSliceIntoVolume, whose source is compiled
// unchanged from a folder that the user names (`make peers IGSIO=FOLDER`).
//
//   igsio FOLDER
//
// The folder has a job that the bench wrote. job.txt has the numbers of voxels, the first voxel's
// place in mm and the spacing in mm, each x y z, then width, height and number of the frames.
// frames.raw has the frames' pixels, 8 bits each. poses.raw has 16 numbers of 64 bits a frame in
// the machine's order, row by row: world from image, mm from pixels.
//
// Each command is a line on stdin, and each answer a line on stdout.
//
//     insert METHOD THREADS X Y WIDTH HEIGHT
//         inserts the rectangle of every frame into a new volume  -> ms of each frame
//     save FILE
//         writes the volume's values, 8 bits each, and then its weights, 16 bits each in the
//         machine's order, x fastest  -> saved
//
// METHOD is nearest or linear. The mean is kept, and the optimisation is the one that IGSIO names
// best for each method. The volume is cleared before the first frame, which is not timed.
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

#include <vtkImageData.h>
#include <vtkMatrix4x4.h>
#include <vtkNew.h>

#include "vtkIGSIOPasteSliceIntoVolume.h"

namespace {

[[noreturn]] void fail(const std::string &what) {
    std::cerr << "igsio: " << what << std::endl;
    std::exit(1);
}

template <typename T> std::vector<T> read(const std::string &path, size_t count) {
    std::vector<T> all(count);
    std::ifstream file(path, std::ios::binary);
    file.read(reinterpret_cast<char *>(all.data()), static_cast<std::streamsize>(count * sizeof(T)));
    if (!file) fail(path + " is too short or cannot be read");
    return all;
}

struct Job {
    int voxels[3];
    double origin[3];
    double spacing[3];
    int size[2];
    int count;
    std::vector<uint8_t> pixels;
    std::vector<double> poses;

    explicit Job(const std::string &folder) {
        std::ifstream text(folder + "/job.txt");
        for (int &n : voxels) text >> n;
        for (double &mm : origin) text >> mm;
        for (double &mm : spacing) text >> mm;
        text >> size[0] >> size[1] >> count;
        if (!text) fail(folder + "/job.txt is no job");
        pixels = read<uint8_t>(folder + "/frames.raw", static_cast<size_t>(size[0]) * size[1] * count);
        poses = read<double>(folder + "/poses.raw", static_cast<size_t>(16) * count);
    }
};

using Paste = vtkIGSIOPasteSliceIntoVolume;

// Returns the ms of each frame, with blanks between them.
std::string insert(Paste *paste, const Job &job, std::istream &command) {
    std::string method;
    int threads = 0, corner[2], size[2];
    command >> method >> threads >> corner[0] >> corner[1] >> size[0] >> size[1];
    if (!command || (method != "nearest" && method != "linear")) fail("no such command");
    const bool linear = method == "linear";
    int extent[6];
    for (int axis = 0; axis < 3; axis++) {
        extent[2 * axis] = 0;
        extent[2 * axis + 1] = job.voxels[axis] - 1;
    }
    paste->SetOutputExtent(extent);
    paste->SetOutputOrigin(const_cast<double *>(job.origin));
    paste->SetOutputSpacing(const_cast<double *>(job.spacing));
    paste->SetOutputScalarMode(VTK_UNSIGNED_CHAR);
    paste->SetInterpolationMode(linear ? Paste::LINEAR_INTERPOLATION : Paste::NEAREST_NEIGHBOR_INTERPOLATION);
    // Fixed point is for the nearest voxel; IGSIO's documentation calls it slower for the other.
    paste->SetOptimization(linear ? Paste::PARTIAL_OPTIMIZATION : Paste::FULL_OPTIMIZATION);
    paste->SetCompoundingMode(Paste::MEAN_COMPOUNDING_MODE);
    paste->SetNumberOfThreads(threads);
    // IGSIO takes the corner plus the size as the last pixel.
    paste->SetClipRectangleOrigin(corner[0], corner[1]);
    paste->SetClipRectangleSize(size[0] - 1, size[1] - 1);
    if (paste->ResetOutput() != IGSIO_SUCCESS) fail("the volume cannot be made");

    // All frames are in memory before the first is inserted.
    std::vector<vtkNew<vtkImageData>> frames(job.count);
    const size_t area = static_cast<size_t>(job.size[0]) * job.size[1];
    for (int i = 0; i < job.count; i++) {
        frames[i]->SetDimensions(job.size[0], job.size[1], 1);
        frames[i]->AllocateScalars(VTK_UNSIGNED_CHAR, 1);
        std::memcpy(frames[i]->GetScalarPointer(), job.pixels.data() + area * i, area);
    }
    std::ostringstream answer;
    for (int i = 0; i < job.count; i++) {
        vtkNew<vtkMatrix4x4> pose;
        pose->DeepCopy(job.poses.data() + 16 * i);
        const auto began = std::chrono::steady_clock::now();
        const auto status = paste->InsertSlice(frames[i], pose, i == 0, i + 1 == job.count);
        const std::chrono::duration<double, std::milli> ms = std::chrono::steady_clock::now() - began;
        if (status != IGSIO_SUCCESS) fail("a frame was refused");
        answer << ms.count() << ' ';
    }
    return answer.str();
}

void save(Paste *paste, const Job &job, const std::string &path) {
    const size_t voxels = static_cast<size_t>(job.voxels[0]) * job.voxels[1] * job.voxels[2];
    std::ofstream file(path, std::ios::binary);
    const auto write = [&](vtkImageData *image, size_t size) {
        file.write(static_cast<const char *>(image->GetScalarPointer()), static_cast<std::streamsize>(voxels * size));
    };
    write(paste->GetReconstructedVolume(), sizeof(uint8_t));
    write(paste->GetAccumulationBuffer(), sizeof(uint16_t));
    if (!file.flush()) fail(path + " cannot be written");
}

} // namespace

int main(int count, char **arguments) {
    if (count != 2) fail("usage: igsio FOLDER");
    const Job job(arguments[1]);
    vtkNew<Paste> paste;
    for (std::string line; std::getline(std::cin, line);) {
        std::istringstream command(line);
        std::string verb, path;
        command >> verb;
        if (verb == "insert") {
            std::cout << insert(paste, job, command) << std::endl;
        } else if (verb == "save" && command >> path) {
            save(paste, job, path);
            std::cout << "saved" << std::endl;
        } else {
            fail("no such command: " + line);
        }
    }
}
