// CameraOptions say which camera is used and what it shall do. They are section [camera] of the
// configuration.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace curlew {

enum class Trigger {
  kAsIs,      ///< the camera's own setting stays
  kFree,      ///< frame after frame, no trigger
  kLine,      ///< an edge on trigger_line starts a frame
  kSoftware,  ///< Camera::trigger() starts a frame
};

/// Describes what a plain bulk-streaming USB camera sends: frame after frame on one bulk IN
/// endpoint. Each is `header_bytes`, then rows × cols pixels, row by row without padding, then
/// `trailer_bytes`.
///
/// If sync is given, frames are told apart by it. Otherwise every frame, and nothing else, ends
/// with a short packet (an empty one if the frame's bytes are a multiple of the packet size). A
/// camera with sync may end its frames with short packets too; then they are delivered at once. If
/// it does not, a frame is known to be whole only when the next one begins, so choose
/// transfer_bytes below a frame.
struct UsbLayout {
  int interface_number = 0;   ///< interface with the bulk IN endpoint
  int alternate_setting = 0;  ///< alternate setting of that interface
  int endpoint = 0x81;        ///< address of the bulk IN endpoint
  int rows = 0;               ///< rows of a frame; must be set
  int cols = 0;               ///< columns of a frame; must be set
  int bits = 16;              ///< of a pixel: 8 is one byte, 10 to 16 are two, little endian
  int header_bytes = 0;       ///< bytes before the pixels, with sync and frame number
  int trailer_bytes = 0;      ///< bytes after the pixels, which are skipped
  std::string sync;           ///< what every header begins with, hexadecimal as a55a01ff
  /// Place in the header of a 32-bit little-endian frame number; −1 if frames are counted instead.
  int sequence_offset = -1;
  int transfer_bytes = 1 << 18;  ///< size of a transfer; a multiple of the endpoint's packet size
  int transfers = 16;  ///< transfers at once; together they must fit the kernel's usbfs_memory_mb
};

struct CameraOptions {
  /// Names the camera: "aravis:ID" (a device id, an address, or nothing for the only camera there
  /// is), "usb:VID:PID", "isio:NAME" (a stream in shared memory), "sim:PRESET" or "file:REC.fits".
  std::string source = "aravis:";

  // A GenICam camera is told the following. A field at its default leaves the camera's own value.
  int x_px = -1;             ///< first column of the region
  int y_px = -1;             ///< first row of the region
  int width_px = 0;          ///< columns of the region
  int height_px = 0;         ///< rows of the region
  std::string pixel_format;  ///< the camera's own word: Mono8, Mono10p, Mono12, Mono16, …
  double exposure_us = 0.0;
  /// Whether the exposure follows the light, so that the brightest spots stay at exposure_target of
  /// saturation; while something is recorded only if auto_exposure_recording says so.
  bool auto_exposure = false;
  double exposure_target = 0.6;
  double max_exposure_us = 1e6;  ///< the longest that auto_exposure may set
  bool auto_exposure_recording = false;
  double gain_db = -1.0;
  double frame_rate_hz = 0.0;  ///< also the rate of sim: and file:, where 0 means 1000 Hz
  double readout_us = 0.0;     ///< sim: and file: from first row to last; 0: frames come whole
  Trigger trigger = Trigger::kAsIs;
  std::string trigger_line = "Line0";
  /// Any other GenICam features, name and value, which are set in this order and before the above.
  std::vector<std::pair<std::string, std::string>> features;

  // A GigE Vision camera takes the following, too.
  int packet_size_bytes = 0;          ///< 0 if it is negotiated with the camera
  std::int64_t packet_delay_ns = -1;  ///< delay between packets; −1 leaves it
  int socket_buffer_bytes = 8 << 20;  ///< the kernel's receive buffer, capped by net.core.rmem_max
  bool packet_resend = false;         ///< whether lost packets are asked for; late data is useless
  /// An incomplete frame is given up this long after its last packet.
  std::int64_t frame_retention_us = 20000;

  int buffers = 6;  ///< frames the camera may be filling, beside those in the pipeline
  /// The camera counts as lost after this long without a frame. 0 means never; −1 means 5 s, or
  /// never if the trigger is line or software.
  double timeout_s = -1.0;
  double max_backoff_s = 5.0;  ///< longest pause between two attempts to connect
  UsbLayout usb;
};

/// Returns how long, in s, a silent camera is waited for: timeout_s, or what it stands for if it is
/// −1. 0 means for ever.
inline double longest_silence_s(const CameraOptions& options) {
  constexpr double kDefault_s = 5.0;
  if (options.timeout_s >= 0.0) return options.timeout_s;
  const bool triggered = options.trigger == Trigger::kLine || options.trigger == Trigger::kSoftware;
  return triggered ? 0.0 : kDefault_s;
}

}  // namespace curlew
