#include "acquisition/usb/usb_watcher.h"

#include <pthread.h>

#include <atomic>
#include <thread>
#include <utility>

#include "acquisition/usb/usb_handle.h"

namespace curlew {

struct UsbWatcher::State {
  static int LIBUSB_CALL changed(libusb_context*, libusb_device*, libusb_hotplug_event event,
                                 void* user) {
    static_cast<State*>(user)->report(
        event == LIBUSB_HOTPLUG_EVENT_DEVICE_ARRIVED ? UsbChange::kArrived : UsbChange::kLeft);
    return 0;  // The callback stays registered.
  }

  void watch() const {
    pthread_setname_np(pthread_self(), "usb watcher");
    while (!stop.load()) {
      timeval wait{.tv_sec = 60, .tv_usec = 0};
      libusb_handle_events_timeout_completed(usb.get(), &wait, nullptr);
    }
  }

  UsbContext usb = open_usb();
  std::function<void(UsbChange)> report;
  bool notices = false;
  std::atomic<bool> stop{false};
  std::thread thread;
};

UsbWatcher::UsbWatcher(std::function<void(UsbChange)> changed) : state_(std::make_unique<State>()) {
  state_->report = std::move(changed);
  state_->notices =
      libusb_has_capability(LIBUSB_CAP_HAS_HOTPLUG) != 0 &&
      libusb_hotplug_register_callback(
          state_->usb.get(), LIBUSB_HOTPLUG_EVENT_DEVICE_ARRIVED | LIBUSB_HOTPLUG_EVENT_DEVICE_LEFT,
          0, LIBUSB_HOTPLUG_MATCH_ANY, LIBUSB_HOTPLUG_MATCH_ANY, LIBUSB_HOTPLUG_MATCH_ANY,
          &State::changed, state_.get(), nullptr) == LIBUSB_SUCCESS;
  if (state_->notices) state_->thread = std::thread([state = state_.get()] { state->watch(); });
}

UsbWatcher::~UsbWatcher() {
  if (!state_->thread.joinable()) return;
  state_->stop.store(true);
  libusb_interrupt_event_handler(state_->usb.get());
  state_->thread.join();
}

bool UsbWatcher::notices() const { return state_->notices; }

}  // namespace curlew
