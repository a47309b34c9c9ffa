// This fakes a GigE Vision camera: it sends real packets over loopback, with images of our own.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

// These types are Aravis', whose header stays in the .cpp.
struct _ArvBuffer;
struct _ArvGvFakeCamera;

namespace curlew {

struct FakeGigeOptions {
  std::string address = "127.0.0.1";    ///< an address takes one camera; see loopback.h
  std::string serial = "CURLEW";        ///< the device id is Aravis-Fake-<serial>
  std::string pixel_format = "Mono16";  ///< one that Curlew reads; a client may set another
  double frame_rate_hz = 100;           ///< a client may set another, up to 10 kHz
  double lost_packet_ratio = 0;
  bool once = false;  ///< sends every image once per start, then nothing more
  /// The exposure time at which frames are the images; at others, Mono16 pixels are as many times
  /// brighter or darker, up to saturation. 0: frames do not depend on the exposure.
  double image_exposure_us = 0;
  double saturation = 65535;
  std::string vendor;  ///< what it says who made it; empty: Aravis
  /// Says what becomes of the camera's description of itself.
  std::function<std::string(std::string)> edit_description;
};

/// Serves images over and over while the object lives. Its frame numbers wrap from 65535 to 1 soon.
/// Which image a frame shows follows from its number alone.
class FakeGigeCamera {
 public:
  static constexpr std::int64_t kFirstNumber = 65401;

  /// images: the bytes of each frame as the pixel format has them, rows × cols. A client that sets
  /// a smaller region of unpacked pixels gets that cut-out.
  FakeGigeCamera(int rows, int cols, std::vector<std::vector<std::byte>> images,
                 const FakeGigeOptions& options = {});
  ~FakeGigeCamera();
  FakeGigeCamera(const FakeGigeCamera&) = delete;
  FakeGigeCamera& operator=(const FakeGigeCamera&) = delete;

  /// Returns which of `images` the frame shows whose number, wrapped or counted on, is `sequence`.
  static std::size_t image_of(std::int64_t sequence, std::size_t images);

  void set_lost_packet_ratio(double ratio);
  /// Frames have this many rows and columns from now on, though the client was told otherwise.
  void deform(int rows, int cols);
  /// Returns the port of the client that it sends frames to, and the port that it sends them from.
  int stream_port() const;
  int sending_port() const;
  /// Returns how many frames were sent since the beginning.
  std::int64_t frames_sent() const { return frames_sent_; }

 private:
  static void fill(_ArvBuffer* buffer, void* self, std::uint32_t exposure_us, std::uint32_t gain,
                   std::uint32_t pixel_format);

  const int rows_;
  const int cols_;
  const std::vector<std::vector<std::byte>> images_;
  const bool once_;
  const double image_exposure_us_;
  const double saturation_;
  _ArvGvFakeCamera* camera_ = nullptr;
  std::atomic<std::int64_t> frames_sent_{0};
};

}  // namespace curlew
