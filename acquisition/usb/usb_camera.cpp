#include "acquisition/usb/usb_camera.h"

#include <pthread.h>
#include <spdlog/fmt/fmt.h>

#include <atomic>
#include <chrono>
#include <cstddef>
#include <mutex>
#include <optional>
#include <span>
#include <thread>
#include <utility>

#include "acquisition/usb/usb_frame_assembler.h"
#include "acquisition/usb/usb_handle.h"
#include "core/error.h"
#include "core/utc_now.h"

namespace curlew {
namespace {

using std::chrono::steady_clock;

/// Cancelled transfers of a healthy kernel come back within microseconds.
constexpr auto kLongestDrain = std::chrono::seconds(1);

UsbFrameAssembler::Arrival now() { return {steady_clock::now(), utc_now_ns()}; }

/// Returns why a transfer came back without success.
const char* transfer_failure(libusb_transfer_status status) {
  switch (status) {
    case LIBUSB_TRANSFER_NO_DEVICE:
      return "it was unplugged or switched off";
    case LIBUSB_TRANSFER_STALL:
      return "it stalled its endpoint";
    case LIBUSB_TRANSFER_OVERFLOW:
      return "it sent more than was asked for: [usb] transfer_bytes must be a multiple of the "
             "endpoint's packet size";
    default:
      return "a USB transfer failed: cable, hub, or unplugged";
  }
}

class UsbCamera final : public Camera {
 public:
  UsbCamera(std::uint16_t vendor_id, std::uint16_t product_id, const UsbLayout& layout,
            ThreadStart thread_start);
  ~UsbCamera() override { stop(); }
  UsbCamera(const UsbCamera&) = delete;
  UsbCamera& operator=(const UsbCamera&) = delete;

  const FrameFormat& format() const override { return format_; }
  std::string description() const override { return description_; }
  std::vector<std::string> notes() const override { return notes_; }
  void start(FrameExchange& exchange) override;
  void stop() noexcept override;
  std::string failure() const override {
    const std::lock_guard lock(failure_mutex_);
    return failure_;
  }
  FrameCounts counts() const override { return assembler_ ? assembler_->counts() : FrameCounts(); }

 private:
  libusb_device* find(std::uint16_t vendor_id, std::uint16_t product_id,
                      const UsbDeviceList& devices);
  int check_endpoint(libusb_device* device) const;
  void claim(bool choose_setting);
  int submit(libusb_transfer* transfer) noexcept;
  static void LIBUSB_CALL completed(libusb_transfer* transfer) {
    static_cast<UsbCamera*>(transfer->user_data)->take(*transfer);
  }
  void take(libusb_transfer& transfer) noexcept;
  void fail(const std::string& why) noexcept;
  void stream() noexcept;
  void drain() noexcept;

  std::string name_;  ///< the word that --camera takes
  UsbLayout layout_;
  FrameFormat format_;
  ThreadStart thread_start_;
  std::string description_;
  std::vector<std::string> notes_;

  // These are closed in the opposite order: transfers, then the device, then libusb.
  UsbContext usb_ = open_usb();
  UsbHandle handle_;
  std::vector<std::byte> memory_;
  std::vector<UsbTransfer> ring_;

  FrameExchange* exchange_ = nullptr;
  std::optional<UsbFrameAssembler> assembler_;
  int under_way_ = 0;  ///< transfers under way; start() counts them, then the thread does
  std::atomic<bool> stopping_{false};  ///< stop() was called
  bool failed_ = false;  ///< the thread's own: transfers that come back are not sent again
  std::thread thread_;
  mutable std::mutex failure_mutex_;
  std::string failure_;
};

UsbCamera::UsbCamera(std::uint16_t vendor_id, std::uint16_t product_id, const UsbLayout& layout,
                     ThreadStart thread_start)
    : name_(fmt::format("usb:{:04x}:{:04x}", vendor_id, product_id)),
      layout_(layout),
      format_(usb_frame_format(layout)),
      thread_start_(std::move(thread_start)) {
  const UsbDeviceList devices(usb_.get());
  libusb_device* device = find(vendor_id, product_id, devices);
  description_ = usb_description(device);
  const int settings = check_endpoint(device);
  libusb_device_handle* handle = nullptr;
  if (const int error = libusb_open(device, &handle); error != LIBUSB_SUCCESS) {
    throw Failure(fmt::format("{}: {}", name_, usb_open_problem(device, error)));
  }
  handle_.reset(handle);
  claim(settings > 1);
}

libusb_device* UsbCamera::find(std::uint16_t vendor_id, std::uint16_t product_id,
                               const UsbDeviceList& devices) {
  libusb_device* found = nullptr;
  int alike = 0;
  for (libusb_device* device : devices) {
    libusb_device_descriptor about{};
    libusb_get_device_descriptor(device, &about);
    if (about.idVendor != vendor_id || about.idProduct != product_id) continue;
    if (alike++ == 0) found = device;
  }
  if (found == nullptr) {
    throw Failure(
        fmt::format("{}: no such USB device is attached; 'curlew cameras' lists what is", name_));
  }
  if (alike > 1) {
    notes_.push_back(fmt::format("{} devices are {}: the first is used", alike, name_));
  }
  return found;
}

/// Returns how many alternate settings the interface has. Throws if the layout does not fit the
/// device.
int UsbCamera::check_endpoint(libusb_device* device) const {
  const UsbConfig config = active_config(device);
  if (!config) throw Failure(name_ + ": its descriptors cannot be read; plug it in again");
  std::string others;
  for (const auto& interface : std::span(config->interface, config->bNumInterfaces)) {
    for (int i = 0; i < interface.num_altsetting; ++i) {
      const libusb_interface_descriptor& setting = interface.altsetting[i];
      for (const auto& endpoint : std::span(setting.endpoint, setting.bNumEndpoints)) {
        if (!is_bulk_in(endpoint)) continue;
        if (setting.bInterfaceNumber == layout_.interface_number &&
            setting.bAlternateSetting == layout_.alternate_setting &&
            endpoint.bEndpointAddress == layout_.endpoint) {
          const int packet = endpoint.wMaxPacketSize & 0x7ff;
          if (packet > 0 && layout_.transfer_bytes % packet == 0 && layout_.transfers > 0) {
            return interface.num_altsetting;
          }
          throw UsageError(fmt::format(
              "[usb] transfers = {} and transfer_bytes = {}: the size must be a multiple of the {} "
              "bytes of the camera's packets",
              layout_.transfers, layout_.transfer_bytes, packet));
        }
        others += fmt::format("; interface = {}, alternate_setting = {}, endpoint = 0x{:02x}",
                              setting.bInterfaceNumber, setting.bAlternateSetting,
                              endpoint.bEndpointAddress);
      }
    }
  }
  throw UsageError(fmt::format(
      "{}: it has no bulk IN endpoint 0x{:02x} in [usb] interface = {}, alternate_setting = {}{}{}",
      name_, layout_.endpoint, layout_.interface_number, layout_.alternate_setting,
      others.empty() ? ", nor elsewhere" : "; it has", others));
}

void UsbCamera::claim(bool choose_setting) {
  libusb_set_auto_detach_kernel_driver(handle_.get(),
                                       1);  // Not every system can do this.
  int error = libusb_claim_interface(handle_.get(), layout_.interface_number);
  if (error == LIBUSB_ERROR_BUSY) {
    throw Failure(fmt::format("{}: interface {} is in use by another program; end that first",
                              name_, layout_.interface_number));
  }
  if (error == LIBUSB_SUCCESS && choose_setting) {
    error = libusb_set_interface_alt_setting(handle_.get(), layout_.interface_number,
                                             layout_.alternate_setting);
  }
  if (error != LIBUSB_SUCCESS) {
    throw Failure(fmt::format("{}: interface {}, alternate setting {} cannot be used: {}", name_,
                              layout_.interface_number, layout_.alternate_setting,
                              libusb_strerror(error)));
  }
}

void UsbCamera::start(FrameExchange& exchange) {
  if (!handle_) throw Failure(name_ + ": it died and must be opened again");
  exchange_ = &exchange;
  assembler_.emplace(
      layout_, [&exchange] { return exchange.empty(); },
      [&exchange](FrameBuffer* frame) { return exchange.deliver(frame); });
  stopping_ = failed_ = false;
  failure_.clear();
  libusb_clear_halt(handle_.get(), static_cast<unsigned char>(layout_.endpoint));

  const auto size = static_cast<std::size_t>(layout_.transfer_bytes);
  memory_.resize(size * static_cast<std::size_t>(layout_.transfers));
  ring_.resize(static_cast<std::size_t>(layout_.transfers));
  int error = LIBUSB_SUCCESS;
  for (std::size_t i = 0; i < ring_.size() && error == LIBUSB_SUCCESS; ++i) {
    if (!ring_[i]) ring_[i].reset(libusb_alloc_transfer(0));
    if (!ring_[i]) throw std::bad_alloc();
    libusb_fill_bulk_transfer(ring_[i].get(), handle_.get(),
                              static_cast<unsigned char>(layout_.endpoint),
                              reinterpret_cast<unsigned char*>(memory_.data() + i * size),
                              layout_.transfer_bytes, &UsbCamera::completed, this, 0);
    error = submit(ring_[i].get());
  }
  if (error != LIBUSB_SUCCESS) {
    stopping_ = true;
    drain();
    throw Failure(fmt::format(
        "{}: streaming does not start: {}", name_,
        error == LIBUSB_ERROR_NO_MEM ? usb_memory_advice(layout_) : libusb_strerror(error)));
  }
  thread_ = std::thread([this] { stream(); });
}

void UsbCamera::stop() noexcept {
  if (!thread_.joinable()) return;
  stopping_ = true;
  libusb_interrupt_event_handler(usb_.get());
  thread_.join();
}

int UsbCamera::submit(libusb_transfer* transfer) noexcept {
  const int error = libusb_submit_transfer(transfer);
  if (error == LIBUSB_SUCCESS) ++under_way_;
  return error;
}

/// Takes in a transfer that has come back: in the camera's thread, in the order of the bytes.
void UsbCamera::take(libusb_transfer& transfer) noexcept {
  --under_way_;
  if (stopping_) return;
  const bool whole = transfer.status == LIBUSB_TRANSFER_COMPLETED;
  assembler_->feed(
      std::as_bytes(std::span(transfer.buffer, static_cast<std::size_t>(transfer.actual_length))),
      whole && transfer.actual_length < transfer.length, now());
  if (failed_) return;
  if (!whole) {
    fail(transfer_failure(transfer.status));
  } else if (const int error = submit(&transfer); error != LIBUSB_SUCCESS) {
    fail(error == LIBUSB_ERROR_NO_DEVICE ? transfer_failure(LIBUSB_TRANSFER_NO_DEVICE)
                                         : libusb_strerror(error));
  }
}

void UsbCamera::fail(const std::string& why) noexcept {
  const std::lock_guard lock(failure_mutex_);
  failure_ = name_ + ": " + why;
  failed_ = true;
}

void UsbCamera::stream() noexcept {
  pthread_setname_np(pthread_self(), "usb camera");
  if (thread_start_) thread_start_();
  while (!stopping_ && !failed_) {
    timeval wait{.tv_sec = 0, .tv_usec = 100000};
    libusb_handle_events_timeout_completed(usb_.get(), &wait, nullptr);
  }
  drain();
  assembler_->end();
  if (failed_) exchange_->close();
}

/// Cancels all transfers and waits until they have come back. If one does not, the device is
/// closed.
void UsbCamera::drain() noexcept {
  for (const UsbTransfer& transfer : ring_) {
    if (transfer) libusb_cancel_transfer(transfer.get());
  }
  const auto deadline = steady_clock::now() + kLongestDrain;
  while (under_way_ > 0 && steady_clock::now() < deadline) {
    timeval wait{.tv_sec = 0, .tv_usec = 10000};
    libusb_handle_events_timeout_completed(usb_.get(), &wait, nullptr);
  }
  if (under_way_ > 0) handle_.reset();
}

}  // namespace

std::unique_ptr<Camera> open_usb_camera(std::uint16_t vendor_id, std::uint16_t product_id,
                                        const CameraOptions& options,
                                        const ThreadStart& thread_start) {
  return std::make_unique<UsbCamera>(vendor_id, product_id, options.usb, thread_start);
}

}  // namespace curlew
