#include "acquisition/open_camera.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <string>

#include "acquisition/aravis/aravis_camera.h"
#include "acquisition/isio/stream_camera.h"
#include "acquisition/paced_camera.h"
#include "acquisition/usb/usb_camera.h"
#include "core/error.h"

namespace curlew {
namespace {

[[noreturn]] void refuse(const std::string& source) {
  std::string text = "camera '";
  text.append(source).append(
      "' is none of aravis:ID, usb:VID:PID, isio:NAME, sim:PRESET and file:RECORDING.fits");
  throw UsageError(text);
}

/// Reads a hexadecimal id: "1AB2" is 0x1ab2.
std::uint16_t usb_id(const std::string& word, const std::string& source) {
  unsigned value = 0;
  const char* end = word.data() + word.size();
  const auto [rest, error] = std::from_chars(word.data(), end, value, 16);
  if (error != std::errc{} || rest != end || value > 0xffff) refuse(source);
  return static_cast<std::uint16_t>(value);
}

/// Returns how a camera of recorded or simulated frames sends them.
Pace pace_of(const CameraOptions& options) {
  return {.rate_hz = options.frame_rate_hz, .readout_us = options.readout_us};
}

}  // namespace

std::unique_ptr<Camera> open_camera(const CameraOptions& options, const ThreadStart& thread_start) {
  const std::string& source = options.source;
  const std::size_t colon = source.find(':');
  if (colon == std::string::npos) refuse(source);
  const std::string kind = source.substr(0, colon);
  const std::string name = source.substr(colon + 1);
  if (options.readout_us > 0.0 && kind != "sim" && kind != "file")
    throw UsageError("camera.readout_us is for sim: and file: cameras; leave it out for " + source);
  if (kind == "aravis") return open_aravis_camera(name, options, thread_start);
  if (kind == "isio") return open_stream_camera(name, thread_start);
  if (kind == "sim") {
    auto camera = open_simulated_camera(name, pace_of(options), thread_start);
    if (options.exposure_us > 0.0) camera->set_exposure_us(options.exposure_us);
    return camera;
  }
  if (kind == "file") return open_file_camera(name, pace_of(options), thread_start);
  if (kind != "usb") refuse(source);
  const std::size_t middle = name.find(':');
  if (middle == std::string::npos) refuse(source);
  return open_usb_camera(usb_id(name.substr(0, middle), source),
                         usb_id(name.substr(middle + 1), source), options, thread_start);
}

bool comes_and_goes(const CameraOptions& options) {
  constexpr std::array kKinds = {"aravis:", "usb:", "isio:"};
  return std::ranges::any_of(kKinds,
                             [&](const char* kind) { return options.source.rfind(kind, 0) == 0; });
}

}  // namespace curlew
