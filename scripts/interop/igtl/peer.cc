// The reference library (Debian's libopenigtlink) as a client of ours, and as a server for ours.
//
//   peer watch PORT DIR    receives messages, writes images to DIR, saves the volume and ends the
//                          session
//   peer serve PORT DIR    sends the frames of DIR/frames.txt and DIR/frames.raw to two clients,
//                          with their poses as TDATA
//
// The exit code is 0 if everything was understood.
#include <igtlCapabilityMessage.h>
#include <igtlClientSocket.h>
#include <igtlImageMessage.h>
#include <igtlOSUtil.h>
#include <igtlServerSocket.h>
#include <igtlStatusMessage.h>
#include <igtlStringMessage.h>
#include <igtlTimeStamp.h>
#include <igtlTrackingDataMessage.h>
#include <igtlTransformMessage.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <map>
#include <string>
#include <thread>
#include <vector>

namespace {

[[noreturn]] void fail(const std::string& why) {
    std::cerr << "peer: " << why << std::endl;
    std::exit(1);
}

double now() {
    return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

template <class Message> typename Message::Pointer body(igtl::Socket* socket, igtl::MessageHeader* header) {
    typename Message::Pointer message = Message::New();
    message->SetMessageHeader(header);
    message->AllocatePack();
    int size = message->GetPackBodySize();
    if (size > 0 && socket->Receive(message->GetPackBodyPointer(), size) != size) fail("a body broke off");
    // Unpacks the body and checks its checksum.
    if (!(message->Unpack(1) & igtl::MessageHeader::UNPACK_BODY)) fail(std::string("not understood: ") + header->GetDeviceType());
    return message;
}

void send(igtl::Socket* socket, igtl::MessageBase* message) {
    message->Pack();
    if (!socket->Send(message->GetPackPointer(), message->GetPackSize())) fail("nothing can be sent");
}

void command(igtl::Socket* socket, const char* device, const char* name) {
    igtl::StringMessage::Pointer text = igtl::StringMessage::New();
    text->SetDeviceName(device);
    std::string content = std::string("<Command Name=\"") + name + "\" />";
    text->SetString(content);
    send(socket, text);
}

// Writes size, middle, steps and values, as the library returns them.
void leave(const std::string& path, igtl::ImageMessage* image) {
    int size[3], part[3], first[3];
    float spacing[3];
    igtl::Matrix4x4 m;
    image->GetDimensions(size);
    image->GetSpacing(spacing);
    image->GetSubVolume(part, first);
    image->GetMatrix(m);
    if (std::memcmp(size, part, sizeof size) != 0) fail("a part of an image");
    if (image->GetScalarType() != igtl::ImageMessage::TYPE_UINT8) fail("not of 8 bits");
    if (image->GetCoordinateSystem() != igtl::ImageMessage::COORDINATE_RAS) fail("not RAS");
    std::ofstream text(path + ".txt");
    text.precision(9);
    text << size[0] << ' ' << size[1] << ' ' << size[2] << '\n' << spacing[0] << ' ' << spacing[1] << ' ' << spacing[2] << '\n';
    for (int row = 0; row < 3; row++) text << m[row][0] << ' ' << m[row][1] << ' ' << m[row][2] << ' ' << m[row][3] << '\n';
    std::ofstream raw(path + ".raw", std::ios::binary);
    raw.write(static_cast<const char*>(image->GetScalarPointer()), (std::streamsize)size[0] * size[1] * size[2]);
}

int watch(int port, const std::string& folder) {
    igtl::ClientSocket::Pointer socket = igtl::ClientSocket::New();
    for (int tries = 0; socket->ConnectToServer("127.0.0.1", port) != 0; tries++) {
        if (tries == 100) fail("no server");
        std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
    igtl::GetCapabilityMessage::Pointer what = igtl::GetCapabilityMessage::New();
    what->SetDeviceName("peer");
    send(socket, what);
    igtl::StartTrackingDataMessage::Pointer start = igtl::StartTrackingDataMessage::New();
    start->SetDeviceName("peer");
    start->SetResolution(50);
    start->SetCoordinateName("");
    send(socket, start);
    std::map<std::string, int> heard;
    std::string saved;
    double begun = now(), latest = 0;
    int slices = 0, volumes = 0, sensors = 0;
    bool asked = false, ended = false;
    while (now() - begun < 60) {
        igtl::MessageHeader::Pointer header = igtl::MessageHeader::New();
        header->InitPack();
        int read = socket->Receive(header->GetPackPointer(), header->GetPackSize());
        if (read <= 0) break;
        if (read != header->GetPackSize()) fail("a header broke off");
        header->Unpack();
        std::string type = header->GetDeviceType(), device = header->GetDeviceName();
        heard[type + " " + device]++;
        igtl::TimeStamp::Pointer time = igtl::TimeStamp::New();
        header->GetTimeStamp(time);
        if (std::abs(time->GetTimeStamp() - now()) > 30) fail("a time that is not of now: " + type);
        if (type == "IMAGE") {
            igtl::ImageMessage::Pointer image = body<igtl::ImageMessage>(socket, header);
            if (device.rfind("Volume", 0) == 0) leave(folder + "/volume-" + std::to_string(volumes++), image);
            else if (slices++ % 10 == 0) leave(folder + "/slice-" + std::to_string(slices / 10), image);
        } else if (type == "TRANSFORM") {
            body<igtl::TransformMessage>(socket, header);
        } else if (type == "TDATA") {
            igtl::TrackingDataMessage::Pointer tools = body<igtl::TrackingDataMessage>(socket, header);
            // At first, a sensor may not have been received yet.
            sensors = std::max(sensors, tools->GetNumberOfTrackingDataElements());
            // A clock may be set back a little while it is being estimated.
            if (time->GetTimeStamp() < latest - 0.25) fail("TDATA runs backwards");
            latest = time->GetTimeStamp();
        } else if (type == "STATUS") {
            igtl::StatusMessage::Pointer status = body<igtl::StatusMessage>(socket, header);
            if (status->GetCode() != igtl::StatusMessage::STATUS_OK && status->GetCode() != igtl::StatusMessage::STATUS_NOT_READY)
                fail(std::string("status: ") + status->GetStatusString());
        } else if (type == "CAPABILITY") {
            igtl::CapabilityMessage::Pointer types = body<igtl::CapabilityMessage>(socket, header);
            if (types->GetNumberOfTypes() < 10 || std::string(types->GetType(0)) != "IMAGE") fail("CAPABILITY lacks what there is");
        } else if (type == "RTS_TDATA") {
            if (body<igtl::RTSTrackingDataMessage>(socket, header)->GetStatus() != 0) fail("TDATA was refused");
        } else if (type == "STRING") {
            std::string text = body<igtl::StringMessage>(socket, header)->GetString();
            if (device == "ACK_1") saved = text;
            if (device == "ACK_2") ended = true;
        } else {
            socket->Skip(header->GetBodySizeToRead(), 0);
            fail("what is this: " + type);
        }
        if (!asked && volumes >= 2 && slices > 100) {
            asked = true;
            command(socket, "CMD_1", "save");
        }
        if (!saved.empty() && !ended && heard["CMD_2"]++ == 0) command(socket, "CMD_2", "stop");
    }
    socket->CloseSocket();
    for (const auto& of : heard) std::cout << of.first << ": " << of.second << std::endl;
    if (saved.find("Status=\"SUCCESS\"") == std::string::npos) fail("the volume was not saved: " + saved);
    if (sensors != 2) fail("not two sensors in TDATA");
    if (!ended) fail("the session did not end when it was told to");
    for (const char* wanted : {"IMAGE Image_Reference", "IMAGE Volume_Reference", "TRANSFORM ProbeToTracker", "TRANSFORM ReferenceToTracker",
                               "TRANSFORM ImageToReference", "TDATA Tracker", "RTS_TDATA peer", "STATUS Sonoweave", "CAPABILITY peer"})
        if (heard[wanted] == 0) fail(std::string("never came: ") + wanted);
    return 0;
}

int serve(int port, const std::string& folder) {
    std::ifstream text(folder + "/frames.txt"), raw(folder + "/frames.raw", std::ios::binary);
    int frames, width, height;
    double hz;
    if (!(text >> frames >> width >> height >> hz)) fail("no frames");
    igtl::ServerSocket::Pointer server = igtl::ServerSocket::New();
    if (server->CreateServer(port) != 0) fail("the port is taken");
    std::vector<igtl::ClientSocket::Pointer> clients;
    while (clients.size() < 2) {
        igtl::ClientSocket::Pointer client = server->WaitForConnection(20000);
        if (client.IsNull()) fail("nobody came");
        clients.push_back(client);
    }
    std::vector<char> pixels((std::size_t)width * height);

    std::vector<std::vector<double>> poses(frames, std::vector<double>(24));
    for (auto& pose : poses)
        for (auto& number : pose) text >> number;
    if (!text) fail("too few numbers");
    double begun = now() + 0.5;
    auto tools = [&](double at, const std::vector<double>& pose) {
        igtl::TrackingDataMessage::Pointer message = igtl::TrackingDataMessage::New();
        message->SetDeviceName("Tracker");
        const char* names[] = {"ProbeToTracker", "ReferenceToTracker"};
        for (int n = 0; n < 2; n++) {
            igtl::TrackingDataElement::Pointer tool = igtl::TrackingDataElement::New();
            tool->SetName(names[n]);
            tool->SetType(igtl::TrackingDataElement::TYPE_6D);
            igtl::Matrix4x4 m;
            igtl::IdentityMatrix(m);
            for (int row = 0; row < 3; row++)
                for (int column = 0; column < 4; column++) m[row][column] = (float)pose[12 * n + 4 * row + column];
            tool->SetMatrix(m);
            message->AddTrackingDataElement(tool);
        }
        igtl::TimeStamp::Pointer time = igtl::TimeStamp::New();
        time->SetTime(at);
        message->SetTimeStamp(time);
        for (auto& client : clients) send(client, message);
    };
    auto wait = [&](double at) {
        if (at > now()) std::this_thread::sleep_for(std::chrono::duration<double>(at - now()));
    };
    // The tracker begins before the first frame, and ends after the last.
    for (int n = 30; n > 0; n--) {
        wait(begun - n / hz);
        tools(begun - n / hz, poses[0]);
    }
    for (int n = 0; n < frames; n++) {
        raw.read(pixels.data(), (std::streamsize)pixels.size());
        double at = begun + n / hz;
        wait(at);
        tools(at, poses[n]);
        igtl::ImageMessage::Pointer image = igtl::ImageMessage::New();
        image->SetDeviceName("Image_Reference");
        image->SetDimensions(width, height, 1);
        image->SetSpacing(1, 1, 1);
        image->SetScalarTypeToUint8();
        image->AllocateScalars();
        std::memcpy(image->GetScalarPointer(), pixels.data(), pixels.size());
        igtl::TimeStamp::Pointer time = igtl::TimeStamp::New();
        time->SetTime(at);
        image->SetTimeStamp(time);
        for (auto& client : clients) send(client, image);
    }
    for (int n = 0; n < 30; n++) {
        wait(begun + (frames + n) / hz);
        tools(begun + (frames + n) / hz, poses[frames - 1]);
    }
    std::this_thread::sleep_for(std::chrono::seconds(2));
    std::cout << frames << " frames sent" << std::endl;
    return 0;
}

} // namespace

int main(int count, char** values) {
    if (count != 4) fail("watch or serve, a port and a folder are wanted");
    std::string what = values[1];
    // A client that leaves first must not end this program by a signal.
    std::signal(13, [](int) {});
    return what == "watch" ? watch(std::atoi(values[2]), values[3]) : serve(std::atoi(values[2]), values[3]);
}
