#include "tests/acquisition/usb/emulated_usb.h"

#include <linux/usbdevice_fs.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <set>
#include <stdexcept>
#include <utility>

// The sanitizers are told this in every run: umockdev is preloaded before ASan's library, and TSan
// does not see the locks inside libraries that are not built with it. Nothing of ours is named.
#if defined(__SANITIZE_ADDRESS__)
extern "C" const char* __asan_default_options() { return "verify_asan_link_order=0"; }
// One run in several, on a machine with much else to do, ends with a device that libusb keeps after
// all its contexts are gone, Aravis' and ours. What we take from libusb is freed by its owners
// (usb_handle.h).
extern "C" const char* __lsan_default_suppressions() { return "leak:libusb-1.0.so\n"; }
#endif
#if defined(__SANITIZE_THREAD__)
extern "C" const char* __tsan_default_suppressions() {
  return "race:libumockdev\nrace:libudev.so\nrace:g_rec_mutex_clear\n"
         "race:libusb_free_transfer\nrace:libglib-2.0.so\n";
}
#endif

namespace curlew {
namespace {

using std::chrono::steady_clock;

/// A reaping ioctl that has nothing to reap is answered after this long, because a plain file,
/// which stands for the device, is always ready, and libusb would spin.
constexpr auto kReapWait = std::chrono::milliseconds(1);
constexpr std::size_t kDeviceBuffer = 1 << 20;

/// These are the devices that may be asked. The mutex is held while one is.
std::mutex alive_mutex;
std::set<void*> alive;

std::string hex(const Bytes& bytes) {
  std::string text;
  for (const std::uint8_t byte : bytes) {
    char digits[3];
    std::snprintf(digits, sizeof digits, "%02X", byte);
    text += digits;
  }
  return text;
}

template <typename... Args>
std::string print(const char* format, Args... args) {
  char text[256];
  std::snprintf(text, sizeof text, format, args...);
  return text;
}

template <typename T>
void set(UMockdevIoctlData* data, std::size_t offset, T value) {
  std::memcpy(data->data + offset, &value, sizeof value);
}

usbdevfs_urb urb_of(UMockdevIoctlData* data) {
  usbdevfs_urb urb;
  std::memcpy(&urb, data->data, sizeof urb);
  return urb;
}

}  // namespace

// umockdev_in_mock_environment() of 0.17.16 says no under its own wrapper, so this looks for the
// preloaded library.
bool usb_can_be_emulated() {
  const char* preloaded = std::getenv("LD_PRELOAD");
  return preloaded != nullptr && std::strstr(preloaded, "umockdev-preload") != nullptr;
}

EmulatedUsb& EmulatedUsb::instance() {
  static EmulatedUsb usb;
  return usb;
}

EmulatedUsb::EmulatedUsb() : testbed_(umockdev_testbed_new()) {}

EmulatedUsb::~EmulatedUsb() { g_object_unref(testbed_); }

std::string EmulatedUsb::root() const {
  gchar* root = umockdev_testbed_get_root_dir(testbed_);
  std::string text = root;
  g_free(root);
  return text;
}

EmulatedUsbDevice::EmulatedUsbDevice(UsbIdentity identity) : identity_(std::move(identity)) {
  {
    const std::lock_guard lock(alive_mutex);
    alive.insert(this);
  }
  ticker_ = std::jthread([this](const std::stop_token& stop) { tick(stop); });
}

void EmulatedUsbDevice::retire() {
  if (plugged()) unplug();
  const std::lock_guard lock(alive_mutex);
  alive.erase(this);
}

EmulatedUsbDevice::~EmulatedUsbDevice() {
  retire();
  ticker_.request_stop();
  ticker_.join();
  const Lock lock(mutex_);
  for (Transfer& transfer : done_) {
    g_clear_pointer(&transfer.buffer, umockdev_ioctl_data_unref);
    umockdev_ioctl_data_unref(transfer.urb);
  }
  // The nodes stay attached, because one that is detached while somebody has it open never answers
  // again.
  for (const auto& [node, connection] : connections_) g_object_unref(connection);
}

std::string EmulatedUsbDevice::node() const { return print("/dev/bus/usb/001/%03d", address_); }

bool EmulatedUsbDevice::plugged() const {
  const Lock lock(mutex_);
  return plugged_;
}

int EmulatedUsbDevice::opened_transfers() const {
  const Lock lock(mutex_);
  return static_cast<int>(pending_.size());
}

void EmulatedUsbDevice::plug() {
  Connection connection = umockdev_ioctl_base_new();
  {
    const Lock lock(mutex_);
    if (plugged_) throw std::logic_error("plugged in already");
    plugged_ = true;
    static int last_address = 4;  // It counts as the kernel does, over all devices.
    address_ = ++last_address;
    connections_.emplace_back(node(), connection);
    outgoing_.clear();
    waiting_bytes_.clear();
  }
  g_signal_connect(connection, "handle-ioctl", G_CALLBACK(&EmulatedUsbDevice::on_ioctl), this);
  GError* error = nullptr;
  if (umockdev_testbed_attach_ioctl(usb_.testbed(), node().c_str(), connection, &error) == 0) {
    throw std::runtime_error(error != nullptr ? error->message : "attach_ioctl");
  }
  const std::string path = "/devices/usb1/1-3";
  std::string text = "P: " + path + "\n" + "N: " + node().substr(5) + "\n";
  text += "E: SUBSYSTEM=usb\nE: DRIVER=usb\nE: DEVTYPE=usb_device\nE: BUSNUM=001\n";
  text += print("E: DEVNUM=%03d\nE: DEVNAME=%s\n", address_, node().c_str());
  text += print("A: idVendor=%04x\\n\nA: idProduct=%04x\\n\n", identity_.vendor_id,
                identity_.product_id);
  text += print("A: busnum=1\\n\nA: devnum=%d\\n\n", address_);
  text += "A: bConfigurationValue=1\\n\nA: speed=5000\\n\n";
  const std::pair<const char*, const std::string&> strings[] = {
      {"manufacturer", identity_.manufacturer},
      {"product", identity_.product},
      {"serial", identity_.serial}};
  for (const auto& [name, value] : strings) {
    if (!value.empty()) text += print("A: %s=%s\\n\n", name, value.c_str());
  }
  text += "H: descriptors=" + hex(identity_.descriptors) + "\n";
  if (umockdev_testbed_add_from_string(usb_.testbed(), text.c_str(), &error) == 0) {
    throw std::runtime_error(error != nullptr ? error->message : "add_from_string");
  }
  syspath_ = "/sys" + path;
}

void EmulatedUsbDevice::unplug() {
  {
    const Lock lock(mutex_);
    plugged_ = false;
    while (!pending_.empty()) complete(0, -ESHUTDOWN);
    outgoing_.clear();
    waiting_bytes_.clear();
    reap();
  }
  taken_.notify_all();
  umockdev_testbed_uevent(usb_.testbed(), syspath_.c_str(), "remove");
  umockdev_testbed_remove_device(usb_.testbed(), syspath_.c_str());
  ::unlink(node().c_str());
}

bool EmulatedUsbDevice::send(int endpoint, std::span<const std::uint8_t> bytes, bool ends_packet) {
  Lock lock(mutex_);
  taken_.wait(lock, [&] { return !plugged_ || waiting_bytes_[endpoint] < kDeviceBuffer; });
  if (!plugged_) return false;
  waiting_bytes_[endpoint] += bytes.size();
  outgoing_[endpoint].push_back({Bytes(bytes.begin(), bytes.end()), 0, ends_packet});
  serve(endpoint);
  reap();
  return true;
}

bool EmulatedUsbDevice::drained() {
  Lock lock(mutex_);
  return taken_.wait_for(lock, std::chrono::seconds(10), [&] {
    return done_.empty() &&
           std::ranges::all_of(outgoing_, [](const auto& queue) { return queue.second.empty(); });
  });
}

void EmulatedUsbDevice::break_transfers(int endpoint, int status) {
  const Lock lock(mutex_);
  for (std::size_t i = 0; i < pending_.size();) {
    if (pending_[i].endpoint == endpoint) {
      complete(i, status);
    } else {
      ++i;
    }
  }
  reap();
}

/// Gives the bytes that wait to the transfers that wait.
void EmulatedUsbDevice::serve(int endpoint) {
  auto& queue = outgoing_[endpoint];
  while (!queue.empty()) {
    const auto found = std::ranges::find(pending_, endpoint, &Transfer::endpoint);
    if (found == pending_.end()) break;
    Outgoing& out = queue.front();
    const std::size_t n =
        std::min(out.bytes.size() - out.taken, found->length - found->data.size());
    const auto from = out.bytes.begin() + static_cast<std::ptrdiff_t>(out.taken);
    found->data.insert(found->data.end(), from, from + static_cast<std::ptrdiff_t>(n));
    out.taken += n;
    waiting_bytes_[endpoint] -= n;
    const bool at_end = out.taken == out.bytes.size();
    // A full transfer ends by itself. If its last packet is full too, an empty one comes after it,
    // and that belongs to another transfer.
    const bool full = found->data.size() == found->length;
    const bool short_packet = at_end && out.ends_packet && !full;
    if (full || short_packet) complete(static_cast<std::size_t>(found - pending_.begin()), 0);
    const bool empty_packet =
        full && out.ends_packet && n > 0 && out.bytes.size() % identity_.packet_bytes == 0;
    if (at_end && !empty_packet) queue.pop_front();
  }
  taken_.notify_all();
}

/// Moves a pending transfer to those that are done, so that it will be reaped.
void EmulatedUsbDevice::complete(std::size_t index, int status) {
  Transfer transfer = std::move(pending_[index]);
  pending_.erase(pending_.begin() + static_cast<std::ptrdiff_t>(index));
  const auto received = static_cast<int>(transfer.data.size());
  if (transfer.buffer != nullptr && received > 0) {
    const std::size_t offset = urb_of(transfer.urb).type == USBDEVFS_URB_TYPE_CONTROL ? 8 : 0;
    std::memcpy(transfer.buffer->data + offset, transfer.data.data(), transfer.data.size());
  }
  set(transfer.urb, offsetof(usbdevfs_urb, status), status);
  if ((transfer.endpoint & 0x80) != 0 || transfer.endpoint == 0) {
    set(transfer.urb, offsetof(usbdevfs_urb, actual_length), received);
  } else {
    set(transfer.urb, offsetof(usbdevfs_urb, actual_length), static_cast<int>(transfer.length));
  }
  done_.push_back(std::move(transfer));
}

/// Answers those callers that want to reap and find something, or that have waited long enough.
void EmulatedUsbDevice::reap() {
  const auto now = steady_clock::now();
  std::erase_if(reaping_, [&](Reaping& one) {
    const auto mine = std::ranges::find(done_, one.connection, &Transfer::connection);
    if (mine != done_.end()) {
      Transfer transfer = std::move(*mine);
      done_.erase(mine);
      umockdev_ioctl_data_set_ptr(one.data, 0, transfer.urb);
      umockdev_ioctl_client_complete(one.client, 0, 0);
      g_clear_pointer(&transfer.buffer, umockdev_ioctl_data_unref);
      umockdev_ioctl_data_unref(transfer.urb);
    } else if (!plugged_ || one.connection != connections_.back().second) {
      umockdev_ioctl_client_complete(one.client, -1, ENODEV);
    } else if (!one.waits && now >= one.deadline) {
      umockdev_ioctl_client_complete(one.client, -1, EAGAIN);
    } else {
      return false;
    }
    umockdev_ioctl_data_unref(one.data);
    g_object_unref(one.client);
    return true;
  });
  taken_.notify_all();
}

void EmulatedUsbDevice::tick(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    std::this_thread::sleep_for(kReapWait);
    const Lock lock(mutex_);
    reap();
  }
}

gboolean EmulatedUsbDevice::on_ioctl(UMockdevIoctlBase* base, UMockdevIoctlClient* client,
                                     gpointer self) {
  const std::lock_guard lock(alive_mutex);
  if (!alive.contains(self)) {
    umockdev_ioctl_client_complete(client, -1, ENODEV);
    return 1;
  }
  return static_cast<EmulatedUsbDevice*>(self)->ioctl(base, client) ? 1 : 0;
}

bool EmulatedUsbDevice::ioctl(Connection connection, UMockdevIoctlClient* client) {
  const gulong request = umockdev_ioctl_client_get_request(client);
  UMockdevIoctlData* arg = umockdev_ioctl_client_get_arg(client);
  const auto answer = [&](glong result, int error) {
    umockdev_ioctl_client_complete(client, result, error);
    return true;
  };
  Lock lock(mutex_);
  const bool reaping = request == USBDEVFS_REAPURB || request == USBDEVFS_REAPURBNDELAY;
  const bool here = plugged_ && connection == connections_.back().second;
  if (!here && !reaping) return answer(-1, ENODEV);
  switch (request) {
    case USBDEVFS_GET_CAPABILITIES: {
      UMockdevIoctlData* data = umockdev_ioctl_data_resolve(arg, 0, sizeof(__u32), nullptr);
      set(data, 0,
          __u32{USBDEVFS_CAP_ZERO_PACKET | USBDEVFS_CAP_NO_PACKET_SIZE_LIM |
                USBDEVFS_CAP_REAP_AFTER_DISCONNECT});
      umockdev_ioctl_data_unref(data);
      return answer(0, 0);
    }
    case USBDEVFS_CLAIMINTERFACE:
    case USBDEVFS_DISCONNECT_CLAIM:
      if (busy) return answer(-1, EBUSY);
      return answer(0, 0);
    case USBDEVFS_RELEASEINTERFACE:
    case USBDEVFS_SETINTERFACE:
    case USBDEVFS_CLEAR_HALT:
    case USBDEVFS_RESET:
      return answer(0, 0);
    case USBDEVFS_GETDRIVER:
      return answer(-1, ENODATA);
    case USBDEVFS_SUBMITURB: {
      UMockdevIoctlData* urb = umockdev_ioctl_data_resolve(arg, 0, sizeof(usbdevfs_urb), nullptr);
      submit(client, urb);
      return true;
    }
    case USBDEVFS_DISCARDURB: {
      std::uintptr_t address = 0;
      std::memcpy(&address, arg->data, sizeof address);
      const bool found = discard(address);
      answer(found ? 0 : -1, found ? 0 : EINVAL);
      reap();
      return true;
    }
    case USBDEVFS_REAPURB:
    case USBDEVFS_REAPURBNDELAY:
      reaping_.push_back({connection, UMOCKDEV_IOCTL_CLIENT(g_object_ref(client)),
                          umockdev_ioctl_data_resolve(arg, 0, sizeof(void*), nullptr),
                          steady_clock::now() + kReapWait, request == USBDEVFS_REAPURB});
      reap();
      return true;
    default:
      return answer(-1, ENOTTY);
  }
}

void EmulatedUsbDevice::submit(UMockdevIoctlClient* client, UMockdevIoctlData* data) {
  const usbdevfs_urb urb = urb_of(data);
  Transfer transfer;
  transfer.connection = connections_.back().second;
  transfer.urb = data;
  transfer.endpoint = urb.endpoint;
  transfer.length = static_cast<std::size_t>(urb.buffer_length);
  std::size_t held = transfer.length;
  for (const Transfer& other : pending_) held += other.length;
  if (held > memory_limit_bytes) {
    umockdev_ioctl_data_unref(data);
    umockdev_ioctl_client_complete(client, -1, ENOMEM);
    return;
  }
  transfer.buffer =
      umockdev_ioctl_data_resolve(data, offsetof(usbdevfs_urb, buffer), transfer.length, nullptr);
  pending_.push_back(transfer);
  umockdev_ioctl_client_complete(client, 0, 0);
  if (urb.type == USBDEVFS_URB_TYPE_CONTROL) {
    answer_control(pending_.back());
  } else if ((urb.endpoint & 0x80) == 0) {
    const Bytes bytes(transfer.buffer->data, transfer.buffer->data + transfer.length);
    complete(pending_.size() - 1, 0);
    mutex_.unlock();
    received(urb.endpoint, bytes);
    mutex_.lock();
  } else {
    serve(urb.endpoint);
  }
}

bool EmulatedUsbDevice::discard(std::uintptr_t address) {
  const auto found = std::ranges::find_if(
      pending_, [&](const Transfer& t) { return t.urb->client_addr == address; });
  if (found == pending_.end()) return false;
  complete(static_cast<std::size_t>(found - pending_.begin()), -ENOENT);
  return true;
}

/// Answers the control requests that are asked here: string descriptors, and to halt an endpoint.
void EmulatedUsbDevice::answer_control(Transfer& transfer) {
  const guint8* setup = transfer.buffer->data;
  const int wanted = setup[6] | setup[7] << 8;
  Bytes text;
  int status = -EPIPE;
  if (setup[0] == 0x80 && setup[1] == 6 && setup[3] == 3) {
    const std::string strings[] = {"", identity_.manufacturer, identity_.product, identity_.serial};
    if (setup[2] == 0) {
      text = {4, 3, 0x09, 0x04};
      status = 0;
    } else if (setup[2] < 4) {
      text = {static_cast<std::uint8_t>(2 + 2 * strings[setup[2]].size()), 3};
      for (const char c : strings[setup[2]]) {
        text.push_back(static_cast<std::uint8_t>(c));
        text.push_back(0);
      }
      status = 0;
    }
  }
  if (setup[0] == 0x02 && setup[1] == 3) status = 0;
  text.resize(std::min(text.size(), static_cast<std::size_t>(wanted)));
  transfer.data = text;
  complete(pending_.size() - 1, status);
}

}  // namespace curlew
