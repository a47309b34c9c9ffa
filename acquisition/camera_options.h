// CameraOptions: which camera, and what it shall do. Section [camera] of the configuration.
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

/// What a plain bulk-streaming USB camera sends: frame after frame on one bulk IN endpoint, each
/// `header_bytes`, then rows × cols pixels, row by row without padding, then `trailer_bytes`.
/// Frames are told apart by sync where it is given; else every frame, and nothing else, ends with a
/// short packet (an empty one where its bytes are a multiple of the packet size). A camera with
/// sync that ends frames with short packets too has them delivered at once; without, a frame is
/// known to be whole only when the next one begins, so choose transfer_bytes below a frame.
struct UsbLayout {
  int interface_number = 0;  ///< interface with the bulk IN endpoint
  int alternate_setting = 0;
  int endpoint = 0x81;       ///< address of the bulk IN endpoint
  int rows = 0;              ///< of a frame; must be set
  int cols = 0;              ///< of a frame; must be set
  int bits = 16;             ///< 8: a byte a pixel; 10 to 16: two bytes, little endian
  int header_bytes = 0;      ///< before the pixels of a frame, with sync and frame number
  int trailer_bytes = 0;     ///< after the pixels of a frame, skipped
  std::string sync;          ///< hexadecimal, as a55a01ff; what every header begins with
  int sequence_offset = -1;  ///< of a 32-bit little-endian frame number in the header; −1: counted
  int transfer_bytes = 1 << 18;  ///< of one transfer; a multiple of the endpoint's packet size
  int transfers = 16;  ///< under way at once; all together below the kernel's usbfs_memory_mb
};

struct CameraOptions {
  /// "aravis:ID" (id, address, or nothing: the only camera there is), "usb:VID:PID", "sim:PRESET"
  /// or "file:REC.fits".
  std::string source = "aravis:";

  // What a GenICam camera is told; a field left at its default leaves the camera's own value.
  int x_px = -1;             ///< region: first column
  int y_px = -1;             ///< region: first row
  int width_px = 0;          ///< region
  int height_px = 0;         ///< region
  std::string pixel_format;  ///< as the camera calls it: Mono8, Mono10p, Mono12, Mono16, …
  double exposure_us = 0.0;
  double gain_db = -1.0;
  double frame_rate_hz = 0.0;  ///< also the rate of sim: (1000 where 0) and file:
  Trigger trigger = Trigger::kAsIs;
  std::string trigger_line = "Line0";
  std::vector<std::pair<std::string, std::string>>
      features;  ///< any other GenICam feature, set in this order

  // GigE Vision.
  int packet_size_bytes = 0;          ///< 0: negotiated with the camera
  std::int64_t packet_delay_ns = -1;  ///< between packets; −1 leaves it
  int socket_buffer_bytes = 8 << 20;  ///< the kernel's receive buffer, capped by net.core.rmem_max
  bool packet_resend = false;         ///< late data is useless data
  /// After the last packet of an incomplete frame; then it is given up.
  std::int64_t frame_retention_us = 20000;

  int buffers = 6;  ///< frames the camera may be filling, beside those in the pipeline
  /// Without a frame for so long the camera counts as lost; 0: never; −1: 5 s, and never where the
  /// trigger is line or software.
  double timeout_s = -1.0;
  double max_backoff_s = 5.0;  ///< longest pause between two attempts to connect
  UsbLayout usb;
};

/// How long a silent camera is waited for: timeout_s, or what it stands for where it is −1.
inline double longest_silence_s(const CameraOptions& options) {
  constexpr double kDefault_s = 5.0;
  if (options.timeout_s >= 0.0) return options.timeout_s;
  const bool triggered = options.trigger == Trigger::kLine || options.trigger == Trigger::kSoftware;
  return triggered ? 0.0 : kDefault_s;
}

}  // namespace curlew
