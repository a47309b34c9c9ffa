#include "acquisition/aravis/aravis_camera.h"

#include <spdlog/fmt/fmt.h>

#include <chrono>
#include <mutex>
#include <thread>
#include <utility>

#include "acquisition/aravis/aravis_discovery.h"
#include "acquisition/aravis/aravis_handle.h"
#include "acquisition/aravis/aravis_network.h"
#include "acquisition/aravis/aravis_receiver.h"
#include "acquisition/aravis/aravis_settings.h"
#include "acquisition/aravis/socket_filter.h"
#include "acquisition/aravis/stream_socket.h"
#include "core/error.h"

namespace curlew {
namespace {

/// Holds all that Aravis' own threads touch when the camera is lost. It lives as long as they may
/// come, which may be longer than the camera does.
class Link {
 public:
  explicit Link(std::string camera_name) : camera_name_(std::move(camera_name)) {}

  void attach(FrameExchange* exchange) {
    const std::lock_guard lock(mutex_);
    exchange_ = exchange;
  }
  void lose() {
    const std::lock_guard lock(mutex_);
    failure_ = fmt::format(
        "{} is lost: it does not answer any more, or another program controls it", camera_name_);
    if (exchange_ != nullptr) exchange_->close();
  }
  std::string failure() const {
    const std::lock_guard lock(mutex_);
    return failure_;
  }

 private:
  mutable std::mutex mutex_;
  const std::string camera_name_;
  FrameExchange* exchange_ = nullptr;
  std::string failure_;
};

class AravisCamera final : public Camera {
 public:
  AravisCamera(CameraPtr camera, CameraOptions options, const ThreadStart& thread_start);
  ~AravisCamera() override;
  AravisCamera(const AravisCamera&) = delete;
  AravisCamera& operator=(const AravisCamera&) = delete;

  const FrameFormat& format() const override { return format_; }
  std::string description() const override { return description_; }
  std::vector<std::string> notes() const override;
  void start(FrameExchange& exchange) override;
  void stop() noexcept override;
  void trigger() override;
  double exposure_us() override;
  double set_exposure_us(double exposure_us) override;
  std::string failure() const override { return link_->failure(); }
  FrameCounts counts() const override {
    FrameCounts counts = receiver_->counts();
    counts.refused_packets =
        socket_.refused() + packets_refused(camera_.get_deleter().control_socket);
    return counts;
  }

 private:
  ArvDevice* device() const { return arv_camera_get_device(camera_.get()); }
  bool answers() const;
  std::uint16_t sending_port() const;
  GObjectPtr<ArvStream> make_stream();

  const CameraOptions options_;
  CameraPtr camera_;
  const bool gige_;
  const std::string address_;  // IPv4 address of a GigE Vision camera; empty for others
  const std::string description_;
  std::vector<std::string> setting_notes_;
  FrameFormat format_;
  std::size_t payload_bytes_ = 0;
  std::shared_ptr<Link> link_;
  std::shared_ptr<AravisReceiver> receiver_;
  gulong lost_handler_ = 0;
  GObjectPtr<ArvStream> stream_;  // the stream while the camera runs
  StreamSocket socket_;           // where its packets arrive, on the network
  FrameExchange* exchange_ = nullptr;
  mutable std::mutex notes_mutex_;
  int receive_buffer_bytes_ = 0;  // size for the stream's socket; 0 before there was one
};

AravisCamera::AravisCamera(CameraPtr camera, CameraOptions options, const ThreadStart& thread_start)
    : options_(std::move(options)),
      camera_(std::move(camera)),
      gige_(arv_camera_is_gv_device(camera_.get())),
      address_(address_of(camera_.get())),
      description_(describe(camera_.get())),
      link_(std::make_shared<Link>(description_)) {
  ArvCamera* const device_camera = camera_.get();
  setting_notes_ = apply_settings(device_camera, description_, options_);
  const PixelCoding& coding = read_pixel_coding(device_camera, description_);
  format_ = read_frame_format(device_camera, description_, coding);
  AravisError error;
  payload_bytes_ = arv_camera_get_payload(device_camera, error.out());
  // Beside the pixels there may be padding and chunks.
  constexpr std::size_t kMuchMore = 2;
  constexpr std::size_t kChunks_bytes = 1 << 20;
  const std::size_t bytes = coding.bytes(format_.pixels());
  if (error || payload_bytes_ < bytes || payload_bytes_ > kMuchMore * bytes + kChunks_bytes)
    throw Failure(
        fmt::format("{} says that it sends {} bytes a frame (PayloadSize), but {} rows of "
                    "{} pixels in {} are {} bytes",
                    description_, payload_bytes_, format_.rows, format_.cols, coding.name, bytes));
  receiver_ = std::make_shared<AravisReceiver>(coding, format_, payload_bytes_,
                                               static_cast<std::size_t>(options_.buffers), gige_,
                                               thread_start);
  if (gige_) {
    // Packets shall come by the plain socket, because the packet socket hands them over 5 ms late.
    arv_camera_gv_set_stream_options(device_camera, ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
    arv_camera_gv_set_packet_size_adjustment(device_camera, ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER);
  } else if (arv_camera_is_uv_device(device_camera)) {
    // The asynchronous mode calls back for no frame and spins while it has no buffer.
    arv_camera_uv_set_usb_mode(device_camera, ARV_UV_USB_MODE_SYNC);
  }
  const auto lose = +[](ArvDevice*, std::shared_ptr<Link>* link) { (*link)->lose(); };
  const auto forget =
      +[](gpointer link, GClosure*) { delete static_cast<std::shared_ptr<Link>*>(link); };
  lost_handler_ = g_signal_connect_data(device(), "control-lost", reinterpret_cast<GCallback>(lose),
                                        new std::shared_ptr<Link>(link_), forget, GConnectFlags{});
}

AravisCamera::~AravisCamera() {
  stop();
  g_signal_handler_disconnect(device(), lost_handler_);
  camera_.get_deleter().lost = !failure().empty();
}

std::vector<std::string> AravisCamera::notes() const {
  std::vector<std::string> notes = setting_notes_;
  {
    const std::lock_guard lock(notes_mutex_);
    if (receive_buffer_bytes_ > 0 && receive_buffer_bytes_ < options_.socket_buffer_bytes)
      notes.push_back(fmt::format(
          "socket_buffer_bytes: asked {}, the kernel gives {}; `sysctl -w "
          "net.core.rmem_max={}` allows it",
          options_.socket_buffer_bytes, receive_buffer_bytes_, options_.socket_buffer_bytes));
  }
  const std::string justification = receiver_->justification();
  if (!justification.empty()) notes.push_back(justification);
  return notes;
}

bool AravisCamera::answers() const {
  return failure().empty() && (!gige_ || gige_device_answers(address_));
}

/// Returns the port that the camera sends its frames from; 0 where it does not tell.
std::uint16_t AravisCamera::sending_port() const {
  constexpr guint64 kStreamSourcePort = 0x0d1c;  // the register SCSP of GigE Vision
  guint32 value = 0;
  AravisError error;
  const bool tells = arv_device_read_register(device(), kStreamSourcePort, &value, error.out());
  return tells && !error ? static_cast<std::uint16_t>(value) : std::uint16_t{0};
}

GObjectPtr<ArvStream> AravisCamera::make_stream() {
  AravisError error;
  GObjectPtr<ArvStream> stream(arv_camera_create_stream(
      camera_.get(), AravisReceiver::on_stream_event, receiver_.get(), error.out()));
  if (stream == nullptr || error)
    throw Failure(fmt::format("{} cannot stream: {}", description_, error.text()));
  if (!gige_) return stream;
  g_object_set(stream.get(), "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED,
               "socket-buffer-size", options_.socket_buffer_bytes, "packet-resend",
               options_.packet_resend ? ARV_GV_STREAM_PACKET_RESEND_ALWAYS
                                      : ARV_GV_STREAM_PACKET_RESEND_NEVER,
               "frame-retention", static_cast<guint>(options_.frame_retention_us), nullptr);
  socket_.guard(arv_gv_stream_get_port(ARV_GV_STREAM(stream.get())), {address_, sending_port()});
  // Aravis sets the buffer after the first packet, which is too late for the rest of the first
  // frame.
  const int bytes = socket_.set_receive_buffer(options_.socket_buffer_bytes);
  const std::lock_guard lock(notes_mutex_);
  receive_buffer_bytes_ = bytes;
  return stream;
}

void AravisCamera::start(FrameExchange& exchange) {
  if (const std::string lost = failure(); !lost.empty()) throw Failure(lost);
  receiver_->begin(exchange);
  exchange_ = &exchange;
  try {
    stream_ = make_stream();
    receiver_->feed(stream_.get());
    link_->attach(&exchange);
    AravisError error;
    arv_camera_start_acquisition(camera_.get(), error.out());
    if (error) throw Failure(fmt::format("{} does not start: {}", description_, error.text()));
  } catch (...) {
    stop();
    throw;
  }
}

void AravisCamera::stop() noexcept {
  if (exchange_ == nullptr) return;
  link_->attach(nullptr);
  socket_.forget();
  AravisError error;
  bool alive = answers();
  if (alive) {
    arv_camera_stop_acquisition(camera_.get(), error.out());
    alive = !error;
  }
  if (alive) {
    stream_.reset();
  } else {
    // Aravis ends the stream's thread and then waits seconds for the camera's answer, so this is
    // left to another thread.
    std::thread([receiver = receiver_, stream = stream_.release()] {
      if (stream != nullptr) g_object_unref(stream);
    }).detach();
  }
  receiver_->wait_for_thread();
  receiver_->end();
  exchange_ = nullptr;
}

void AravisCamera::trigger() {
  AravisError error;
  arv_camera_software_trigger(camera_.get(), error.out());
  if (error)
    throw Failure(fmt::format("{} takes no software trigger: {}", description_, error.text()));
}

double AravisCamera::exposure_us() {
  AravisError error;
  const double exposure_us = arv_camera_get_exposure_time(camera_.get(), error.out());
  return error ? 0.0 : exposure_us;
}

double AravisCamera::set_exposure_us(double exposure_us) {
  double low = 0.0;
  double high = 0.0;
  AravisError error;
  arv_camera_get_exposure_time_bounds(camera_.get(), &low, &high, error.out());
  if (!error)
    arv_camera_set_exposure_time(camera_.get(), std::clamp(exposure_us, low, std::max(low, high)),
                                 error.out());
  if (error) throw Failure(fmt::format("{} takes no exposure: {}", description_, error.text()));
  return this->exposure_us();
}

}  // namespace

std::unique_ptr<Camera> open_aravis_camera(const std::string& id, const CameraOptions& options,
                                           const ThreadStart& thread_start) {
  return std::make_unique<AravisCamera>(open_aravis_device(id), options, thread_start);
}

}  // namespace curlew
