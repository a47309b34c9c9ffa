#include "acquisition/aravis/aravis_discovery.h"

#include <fcntl.h>
#include <spdlog/fmt/fmt.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <mutex>
#include <thread>
#include <vector>

#include "acquisition/aravis/aravis_camera.h"
#include "acquisition/aravis/aravis_network.h"
#include "acquisition/aravis/genicam_description.h"
#include "acquisition/aravis/socket_filter.h"
#include "core/error.h"
#include "core/printable.h"

namespace curlew {
namespace {

constexpr const char* kRemedy =
    "`curlew cameras` lists what is attached; a GigE Vision camera needs power and an address in "
    "the subnet of the network interface it is on, a USB3 Vision camera a udev rule that lets this "
    "user open it";

/// Silences Aravis, which complains on the terminal by itself; our sentences say the same.
void silence_aravis() {
  static std::once_flag once;
  std::call_once(once, [] {
    if (g_getenv("ARV_DEBUG") != nullptr) return;
    arv_debug_enable("all:0");
    // Libraries below it complain of what cameras send in their own words.
    g_log_set_default_handler([](const char*, GLogLevelFlags, const char*, gpointer) {}, nullptr);
  });
}

/// Throws Failure if the process may not open some more files. Aravis 0.8.26 does not survive that
/// it is refused a socket; it needs a few for each network interface, and some for a camera.
void require_free_descriptors() {
  constexpr int kEnough = 64;
  std::vector<int> opened;
  while (static_cast<int>(opened.size()) < kEnough) {
    const int file = fcntl(STDERR_FILENO, F_DUPFD_CLOEXEC, 0);
    if (file < 0) break;
    opened.push_back(file);
  }
  const bool enough = static_cast<int>(opened.size()) == kEnough || errno == EBADF;
  for (const int file : opened) close(file);
  if (!enough)
    throw Failure(fmt::format(
        "aravis: only {} more files may be opened, and cameras may need {}; raise the limit "
        "(`ulimit -n`, or LimitNOFILE= of the unit)",
        opened.size(), kEnough));
}

/// Makes Aravis forget USB cameras that have been unplugged. It would open one, and complain on the
/// terminal. To look anew costs milliseconds on USB; on the network it would cost a second.
void forget_unplugged() {
#if ARAVIS_HAS_USB
  arv_interface_update_device_list(ARV_INTERFACE(arv_uv_interface_get_instance()));
#endif
}

struct Device {
  std::string id;
  std::string description;
};

std::string describe(const std::string& vendor, const std::string& model, const std::string& serial,
                     const std::string& address) {
  std::string text = fmt::format("{} {}", vendor, model);
  if (!serial.empty()) text += fmt::format(", serial number {}", serial);
  if (!address.empty()) text += fmt::format(", {}", address);
  return printable(text);
}

std::vector<Device> find_devices() {
  silence_aravis();
  require_free_descriptors();
  arv_update_device_list();
  std::vector<Device> devices;
  for (unsigned i = 0; i < arv_get_n_devices(); ++i)
    devices.push_back(
        {printable(text_or_empty(arv_get_device_id(i))),
         describe(text_or_empty(arv_get_device_vendor(i)), text_or_empty(arv_get_device_model(i)),
                  text_or_empty(arv_get_device_serial_nbr(i)),
                  text_or_empty(arv_get_device_address(i)))});
  return devices;
}

std::string address_of(ArvGvDevice* device) {
  GSocketAddress* socket = arv_gv_device_get_device_address(device);
  const std::unique_ptr<char, GFree> text(
      g_inet_address_to_string(g_inet_socket_address_get_address(G_INET_SOCKET_ADDRESS(socket))));
  return text.get();
}

std::string only_device() {
  const std::vector<Device> devices = find_devices();
  if (devices.empty())
    throw Failure(fmt::format("aravis: there is no GenICam camera; {}", kRemedy));
  if (devices.size() > 1) {
    std::string names;
    for (const auto& device : devices)
      names += fmt::format("{}aravis:{}", names.empty() ? "" : ", ", device.id);
    throw Failure(fmt::format("aravis: there are {} cameras; name one: {}", devices.size(), names));
  }
  return devices.front().id;
}

}  // namespace

void ReleaseCamera::operator()(ArvCamera* camera) const noexcept {
  const std::string address = address_of(camera);
  if (!lost && (address.empty() || gige_device_answers(address))) {
    g_object_unref(camera);
    return;
  }
  std::thread([camera] {
    // The thread that reports the loss must drop its own reference first; otherwise Aravis would
    // make it wait for itself.
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    g_object_unref(camera);
  }).detach();
}

CameraPtr open_aravis_device(const std::string& id) {
  silence_aravis();
  require_free_descriptors();
  const std::string name = id.empty() ? only_device() : id;
  forget_unplugged();
  AravisError error;
  const auto refuse = [&] {
    throw Failure(fmt::format("aravis:{} cannot be opened: {}; {}", name, error.text(), kRemedy));
  };
  const std::vector<UdpSocket> sockets = udp_sockets();
  const GObjectPtr<ArvDevice> device(arv_open_device(name.c_str(), error.out()));
  if (device == nullptr || error) refuse();
  const int control = ARV_IS_GV_DEVICE(device.get())
                          ? guard_control_channel(sockets, address_of(ARV_GV_DEVICE(device.get())))
                          : -1;
  // Nothing has evaluated the description until here.
  std::size_t size = 0;
  const char* const description = arv_device_get_genicam_xml(device.get(), &size);
  check_genicam_description({description, description != nullptr ? size : 0}, "aravis:" + name);
  CameraPtr camera(arv_camera_new_with_device(device.get(), error.out()));
  if (camera == nullptr || error) refuse();
  camera.get_deleter().control_socket = control;
  if (arv_camera_is_gv_device(camera.get()) &&
      !arv_gv_device_is_controller(ARV_GV_DEVICE(arv_camera_get_device(camera.get())))) {
    if (!gige_device_answers(address_of(camera.get())))
      throw Failure(fmt::format("aravis:{} stopped answering while it was opened", name));
    throw Failure(fmt::format(
        "aravis:{} is controlled by another program; end that one, or wait some seconds where it "
        "has died",
        name));
  }
  return camera;
}

std::string address_of(ArvCamera* camera) {
  if (!arv_camera_is_gv_device(camera)) return {};
  return address_of(ARV_GV_DEVICE(arv_camera_get_device(camera)));
}

std::string describe(ArvCamera* camera) {
  const std::string address = address_of(camera);
  const auto text = [&](auto* read) {
    AravisError error;
    std::string answer = text_or_empty(read(camera, error.out()));
    // If the camera is gone, each of these calls takes seconds to fail. An error alone may only
    // mean that the camera does not have the text.
    if (error && !address.empty() && !gige_device_answers(address))
      throw Failure(fmt::format("aravis:{} stopped answering while it was opened", address));
    // What comes with an error is whatever was in memory.
    return error ? std::string() : answer;
  };
  const std::string vendor = text(arv_camera_get_vendor_name);
  const std::string model = text(arv_camera_get_model_name);
  const std::string serial = text(arv_camera_get_device_serial_number);
  return describe(vendor, model, serial, address);
}

std::vector<CameraListing> list_aravis_cameras() {
  std::vector<CameraListing> listings;
  for (const auto& device : find_devices())
    listings.push_back({"aravis:" + device.id, device.description, {}});
  return listings;
}

}  // namespace curlew
