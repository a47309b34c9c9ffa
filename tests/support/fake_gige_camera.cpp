#include "tests/support/fake_gige_camera.h"

#include <arpa/inet.h>
#include <arv.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <set>
#include <stdexcept>
#include <utility>

#include "tests/support/scratch_directory.h"

namespace curlew {
namespace {

constexpr std::int64_t kNumbers = 65535;
constexpr int kControlPort = 3956;
// These are registers of GigE Vision.
constexpr std::uint32_t kStreamPort = 0x0d00;
constexpr std::uint32_t kStreamSourcePort = 0x0d1c;

struct Format {
  const char* name;
  ArvPixelFormat code;
};
constexpr Format kFormats[] = {{"Mono10", ARV_PIXEL_FORMAT_MONO_10},
                               {"Mono10p", 0x010A0046u},
                               {"Mono10Packed", ARV_PIXEL_FORMAT_MONO_10_PACKED},
                               {"Mono12", ARV_PIXEL_FORMAT_MONO_12},
                               {"Mono12p", 0x010C0047u},
                               {"Mono12Packed", ARV_PIXEL_FORMAT_MONO_12_PACKED},
                               {"Mono14", ARV_PIXEL_FORMAT_MONO_14}};

ArvPixelFormat code_of(const std::string& name) {
  if (name == "Mono8") return ARV_PIXEL_FORMAT_MONO_8;
  if (name == "Mono16") return ARV_PIXEL_FORMAT_MONO_16;
  for (const auto& format : kFormats)
    if (name == format.name) return format.code;
  throw std::invalid_argument("the fake camera has no pixel format " + name);
}

void replace(std::string& text, const std::string& from, const std::string& to) {
  const std::size_t place = text.find(from);
  if (place == std::string::npos) throw std::runtime_error("Aravis' fake camera has no " + from);
  text.replace(place, from.size(), to);
}

/// Returns Aravis' own description of its fake camera, with more pixel formats and faster frames.
std::string camera_description() {
  GBytes* bytes = g_resources_lookup_data("/org/aravis/arv-fake-camera.xml",
                                          G_RESOURCE_LOOKUP_FLAGS_NONE, nullptr);
  if (bytes == nullptr) throw std::runtime_error("Aravis has no description of its fake camera");
  gsize size = 0;
  const auto* data = static_cast<const char*>(g_bytes_get_data(bytes, &size));
  std::string text(data, size);
  g_bytes_unref(bytes);
  std::string entries;
  for (const auto& format : kFormats)
    entries.append("<EnumEntry Name=\"")
        .append(format.name)
        .append("\" NameSpace=\"Standard\"><Value>")
        .append(std::to_string(format.code))
        .append("</Value></EnumEntry>\n");
  replace(text, "<pValue>PixelFormatRegister</pValue>",
          entries + "<pValue>PixelFormatRegister</pValue>");
  replace(text, "<Min>1000</Min>", "<Min>100</Min>");
  return text;
}

/// Returns the ports of this process' UDP sockets.
std::set<int> udp_ports() {
  std::set<int> ports;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
    const int fd = std::stoi(entry.path().filename().string());
    sockaddr_in address{};
    socklen_t length = sizeof address;
    int type = 0;
    socklen_t type_length = sizeof type;
    if (getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &type_length) == 0 && type == SOCK_DGRAM &&
        getsockname(fd, reinterpret_cast<sockaddr*>(&address), &length) == 0 &&
        address.sin_family == AF_INET)
      ports.insert(ntohs(address.sin_port));
  }
  return ports;
}

/// Says whether nobody has the port yet, because Aravis would share it.
bool is_port_free(const std::string& address) {
  sockaddr_in control{};
  control.sin_family = AF_INET;
  control.sin_port = htons(kControlPort);
  const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  const bool free = inet_pton(AF_INET, address.c_str(), &control.sin_addr) == 1 &&
                    bind(fd, reinterpret_cast<const sockaddr*>(&control), sizeof control) == 0;
  close(fd);
  return free;
}

std::uint32_t value_of(ArvFakeCamera* camera, std::uint32_t address) {
  std::uint32_t value = 0;
  arv_fake_camera_read_register(camera, address, &value);
  return value;
}

/// Makes Mono16 pixels so many times brighter, up to saturation.
void expose(std::byte* pixels, std::size_t bytes, double times, double saturation) {
  for (std::size_t i = 0; i + 1 < bytes; i += 2) {
    std::uint16_t pixel = 0;
    std::memcpy(&pixel, pixels + i, 2);
    pixel = static_cast<std::uint16_t>(std::min(times * pixel, saturation));
    std::memcpy(pixels + i, &pixel, 2);
  }
}

}  // namespace

FakeGigeCamera::FakeGigeCamera(int rows, int cols, std::vector<std::vector<std::byte>> images,
                               const FakeGigeOptions& options)
    : rows_(rows),
      cols_(cols),
      images_(std::move(images)),
      once_(options.once),
      image_exposure_us_(options.image_exposure_us),
      saturation_(options.saturation) {
  const std::string refusal =
      std::string("no fake camera can be had at ")
          .append(options.address)
          .append(": no interface has this address, or another one is there already");
  if (!is_port_free(options.address)) throw std::runtime_error(refusal);
  const ScratchDirectory directory;
  const std::string description = directory / "camera.xml";
  std::ofstream(description) << (options.edit_description
                                     ? options.edit_description(camera_description())
                                     : camera_description());
  const std::set<int> ports_before = udp_ports();
  camera_ = arv_gv_fake_camera_new_full(options.address.c_str(), options.serial.c_str(),
                                        description.c_str());
  if (!arv_gv_fake_camera_is_running(camera_)) {
    g_object_unref(camera_);
    throw std::runtime_error(refusal);
  }
  ArvFakeCamera* fake = arv_gv_fake_camera_get_fake_camera(camera_);
  // Aravis' camera does not tell which port it sends from, as others do. It is the new one.
  for (const int port : udp_ports())
    if (port != kControlPort && !ports_before.contains(port))
      arv_fake_camera_write_register(fake, kStreamSourcePort, static_cast<std::uint32_t>(port));
  const std::pair<std::uint32_t, int> registers[] = {
      {ARV_FAKE_CAMERA_REGISTER_SENSOR_WIDTH, cols},
      {ARV_FAKE_CAMERA_REGISTER_SENSOR_HEIGHT, rows},
      {ARV_FAKE_CAMERA_REGISTER_WIDTH, cols},
      {ARV_FAKE_CAMERA_REGISTER_HEIGHT, rows},
      {ARV_FAKE_CAMERA_REGISTER_PIXEL_FORMAT, static_cast<int>(code_of(options.pixel_format))},
      {ARV_FAKE_CAMERA_REGISTER_ACQUISITION_FRAME_PERIOD_US,
       static_cast<int>(1e6 / options.frame_rate_hz)}};
  for (const auto& [address, value] : registers)
    arv_fake_camera_write_register(fake, address, static_cast<std::uint32_t>(value));
  constexpr std::uint32_t kVendor = 0x48;
  if (!options.vendor.empty())
    arv_fake_camera_write_memory(fake, kVendor,
                                 static_cast<std::uint32_t>(options.vendor.size() + 1),
                                 options.vendor.c_str());
  arv_fake_camera_set_trigger_frequency(fake, 1000);  // So often it looks for a software trigger.
  arv_fake_camera_set_fill_pattern(fake, &FakeGigeCamera::fill, this);
  set_lost_packet_ratio(options.lost_packet_ratio);
}

FakeGigeCamera::~FakeGigeCamera() { g_object_unref(camera_); }

std::size_t FakeGigeCamera::image_of(std::int64_t sequence, std::size_t images) {
  const std::int64_t sent_before = ((sequence - kFirstNumber) % kNumbers + kNumbers) % kNumbers;
  return static_cast<std::size_t>(sent_before) % images;
}

void FakeGigeCamera::set_lost_packet_ratio(double ratio) {
  g_object_set(camera_, "gvsp-lost-ratio", ratio, nullptr);
}

void FakeGigeCamera::deform(int rows, int cols) {
  ArvFakeCamera* fake = arv_gv_fake_camera_get_fake_camera(camera_);
  std::pair<std::uint32_t, int> sides[] = {{ARV_FAKE_CAMERA_REGISTER_WIDTH, cols},
                                           {ARV_FAKE_CAMERA_REGISTER_HEIGHT, rows}};
  // What shrinks comes first, because a frame must always fit its buffer.
  if (static_cast<int>(value_of(fake, ARV_FAKE_CAMERA_REGISTER_HEIGHT)) > rows)
    std::swap(sides[0], sides[1]);
  for (const auto& [side, value] : sides)
    arv_fake_camera_write_register(fake, side, static_cast<std::uint32_t>(value));
}

int FakeGigeCamera::stream_port() const {
  return static_cast<int>(value_of(arv_gv_fake_camera_get_fake_camera(camera_), kStreamPort) &
                          0xFFFFU);
}

int FakeGigeCamera::sending_port() const {
  return static_cast<int>(value_of(arv_gv_fake_camera_get_fake_camera(camera_), kStreamSourcePort) &
                          0xFFFFU);
}

void FakeGigeCamera::fill(ArvBuffer* buffer, void* self, std::uint32_t exposure_us, std::uint32_t,
                          std::uint32_t pixel_format) {
  auto& camera = *static_cast<FakeGigeCamera*>(self);
  ArvFakeCamera* fake = arv_gv_fake_camera_get_fake_camera(camera.camera_);
  const auto number = static_cast<std::int64_t>(arv_buffer_get_frame_id(buffer));
  const std::vector<std::byte>& image = camera.images_[image_of(number, camera.images_.size())];
  // Aravis says that the size is 0.
  auto* to = static_cast<std::byte*>(const_cast<void*>(arv_buffer_get_data(buffer, nullptr)));
  const std::size_t payload = arv_fake_camera_get_payload(fake);
  const auto width = value_of(fake, ARV_FAKE_CAMERA_REGISTER_WIDTH);
  const auto height = value_of(fake, ARV_FAKE_CAMERA_REGISTER_HEIGHT);
  const bool whole = width == static_cast<std::uint32_t>(camera.cols_) &&
                     height == static_cast<std::uint32_t>(camera.rows_);
  if (whole) {
    std::memcpy(to, image.data(), std::min(payload, image.size()));
    if (camera.image_exposure_us_ > 0)
      expose(to, std::min(payload, image.size()), exposure_us / camera.image_exposure_us_,
             camera.saturation_);
  } else {
    const std::size_t pixel_bytes = (pixel_format >> 16 & 0xFFU) / 8;
    const std::size_t line = std::size_t{width} * pixel_bytes;
    const std::size_t x = value_of(fake, ARV_FAKE_CAMERA_REGISTER_X_OFFSET);
    const std::size_t y = value_of(fake, ARV_FAKE_CAMERA_REGISTER_Y_OFFSET);
    for (std::size_t r = 0; r < height; ++r) {
      const std::size_t from = ((y + r) * static_cast<std::size_t>(camera.cols_) + x) * pixel_bytes;
      if (from + line <= image.size()) std::memcpy(to + r * line, image.data() + from, line);
    }
  }
  const std::int64_t sent = ++camera.frames_sent_;
  if (camera.once_ && sent % static_cast<std::int64_t>(camera.images_.size()) == 0)
    arv_fake_camera_write_register(fake, ARV_FAKE_CAMERA_REGISTER_ACQUISITION, 0);
}

}  // namespace curlew
