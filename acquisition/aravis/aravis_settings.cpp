#include "acquisition/aravis/aravis_settings.h"

#include <spdlog/fmt/fmt.h>

#include <charconv>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string_view>
#include <utility>

#include "core/error.h"

namespace curlew {
namespace {

using Texts = GArrayPtr<const char*>;

std::string joined(const Texts& texts, guint count) {
  std::string names;
  for (guint i = 0; i < count; ++i) names += fmt::format("{}{}", i > 0 ? ", " : "", texts[i]);
  return names;
}

bool contains(const Texts& texts, guint count, const std::string& text) {
  for (guint i = 0; i < count; ++i)
    if (text == texts[i]) return true;
  return false;
}

template <typename Number>
std::optional<Number> parse(const std::string& text) {
  Number number{};
  const char* end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, number);
  return error == std::errc{} && rest == end ? std::optional(number) : std::nullopt;
}

/// Sets values one after the other. Errors and notes call each by its configuration key.
class Settings {
 public:
  Settings(ArvCamera* camera, std::string camera_name)
      : camera_(camera), device_(arv_camera_get_device(camera)), name_(std::move(camera_name)) {}

  void set_feature(const std::string& feature, const std::string& value);
  void set_pixel_format(const std::string& format);
  void set_region(const CameraOptions& options);
  void set_frame_rate(double rate_hz);
  void set_exposure(double exposure_us);
  void set_gain(double gain_db);
  void set_trigger(Trigger trigger, const std::string& line);
  void set_packets(const CameraOptions& options);

  std::vector<std::string> notes;

 private:
  /// Makes a call of Aravis that reports errors by its last argument. Throws Failure if it does.
  template <typename Call, typename... Arguments>
  auto ask(const std::string& key, Call* call, Arguments... arguments) {
    AravisError error;
    if constexpr (std::is_void_v<decltype(call(camera_, arguments..., error.out()))>) {
      call(camera_, arguments..., error.out());
      if (error) refuse(key, error.text());
    } else {
      auto answer = call(camera_, arguments..., error.out());
      if (error) refuse(key, error.text());
      return answer;
    }
  }
  [[noreturn]] void refuse(const std::string& key, const std::string& why) const {
    throw Failure(fmt::format("camera.{}: {} refuses: {}", key, name_, why));
  }
  [[noreturn]] void wrong(const std::string& key, const std::string& what) const {
    throw UsageError(fmt::format("camera.{}: {} {}", key, name_, what));
  }
  template <typename Number>
  void check_range(const std::string& key, Number value, Number low, Number high,
                   Number step = Number{}) const {
    if (value >= low && value <= high && (step <= Number{1} || std::fmod(value - low, step) == 0))
      return;
    const std::string steps = step > Number{1} ? fmt::format(" in steps of {}", step) : "";
    wrong(key, fmt::format("takes {} to {}{}, not {}", low, high, steps, value));
  }
  template <typename Number>
  void compare(const std::string& key, Number asked, Number done) {
    if (std::abs(static_cast<double>(done - asked)) > 1e-6 * std::abs(static_cast<double>(asked)))
      notes.push_back(fmt::format("{}: asked {}, camera does {}", key, asked, done));
  }
  bool has(const char* feature) {
    AravisError error;
    return arv_device_is_feature_available(device_, feature, error.out()) && !error;
  }
  void set_integer(const std::string& key, const char* feature, std::int64_t value);
  void set_float(const std::string& key, const char* feature, double value);
  void set_enumeration(const std::string& key, const char* feature, const std::string& value);

  ArvCamera* camera_;
  ArvDevice* device_;
  std::string name_;
};

void Settings::set_integer(const std::string& key, const char* feature, std::int64_t value) {
  gint64 low = 0;
  gint64 high = 0;
  ask(key, arv_camera_get_integer_bounds, feature, &low, &high);
  const gint64 step = ask(key, arv_camera_get_integer_increment, feature);
  check_range<gint64>(key, value, low, high, step);
  ask(key, arv_camera_set_integer, feature, gint64{value});
  compare<gint64>(key, value, ask(key, arv_camera_get_integer, feature));
}

void Settings::set_float(const std::string& key, const char* feature, double value) {
  double low = 0;
  double high = 0;
  ask(key, arv_camera_get_float_bounds, feature, &low, &high);
  check_range(key, value, low, high);
  ask(key, arv_camera_set_float, feature, value);
  compare(key, value, ask(key, arv_camera_get_float, feature));
}

void Settings::set_enumeration(const std::string& key, const char* feature,
                               const std::string& value) {
  guint count = 0;
  const Texts entries(ask(key, arv_camera_dup_available_enumerations_as_strings, feature, &count));
  if (!contains(entries, count, value))
    wrong(key, fmt::format("takes {}, not \"{}\"", joined(entries, count), value));
  ask(key, arv_camera_set_string, feature, value.c_str());
  const std::string done = text_or_empty(ask(key, arv_camera_get_string, feature));
  if (done != value) notes.push_back(fmt::format("{}: asked {}, camera does {}", key, value, done));
}

void Settings::set_feature(const std::string& feature, const std::string& value) {
  const std::string key = fmt::format("features.{}", feature);
  const char* name = feature.c_str();
  ArvGcNode* node = arv_device_get_feature(device_, name);
  if (!ARV_IS_GC_FEATURE_NODE(node)) wrong(key, "has no feature of this name");
  if (!has(name)) wrong(key, "does not have this feature available now");
  if (arv_device_get_feature_access_mode(device_, name) == ARV_GC_ACCESS_MODE_RO)
    wrong(key, "lets this feature be read only");
  // An enumeration and a boolean are integers too, so they are looked for first.
  if (ARV_IS_GC_COMMAND(node)) {
    ask(key, arv_camera_execute_command, name);
  } else if (ARV_IS_GC_ENUMERATION(node)) {
    set_enumeration(key, name, value);
  } else if (ARV_IS_GC_BOOLEAN(node)) {
    const bool on = value == "true" || value == "1";
    if (!on && value != "false" && value != "0")
      wrong(key, fmt::format("takes true or false, not \"{}\"", value));
    ask(key, arv_camera_set_boolean, name, on ? TRUE : FALSE);
    const bool done = ask(key, arv_camera_get_boolean, name) != FALSE;
    if (done != on) notes.push_back(fmt::format("{}: asked {}, camera does {}", key, on, done));
  } else if (ARV_IS_GC_FLOAT(node)) {
    const auto number = parse<double>(value);
    if (!number) wrong(key, fmt::format("takes a number, not \"{}\"", value));
    set_float(key, name, *number);
  } else if (ARV_IS_GC_INTEGER(node)) {
    const auto number = parse<std::int64_t>(value);
    if (!number) wrong(key, fmt::format("takes a whole number, not \"{}\"", value));
    set_integer(key, name, *number);
  } else if (ARV_IS_GC_STRING(node)) {
    ask(key, arv_camera_set_string, name, value.c_str());
    const std::string done = text_or_empty(ask(key, arv_camera_get_string, name));
    if (done != value)
      notes.push_back(fmt::format("{}: asked {}, camera does {}", key, value, done));
  } else {
    wrong(key, "has no value here that could be set");
  }
}

void Settings::set_pixel_format(const std::string& format) {
  if (!format.empty()) set_enumeration("pixel_format", "PixelFormat", format);
}

void Settings::set_region(const CameraOptions& options) {
  // The offset bounds the size and the size bounds the offset. Therefore the offset becomes 0, then
  // the size is set, and then the offset.
  const auto set_axis = [&](const char* size_key, int size, const char* size_feature,
                            const char* offset_key, int offset, const char* offset_feature) {
    if (size <= 0 && offset < 0) return;
    const bool movable = has(offset_feature);
    std::int64_t place = offset;
    if (size > 0) {
      if (movable) {
        if (offset < 0) place = ask(offset_key, arv_camera_get_integer, offset_feature);
        ask(offset_key, arv_camera_set_integer, offset_feature, gint64{0});
      }
      set_integer(size_key, size_feature, size);
    }
    if (movable && place >= 0) set_integer(offset_key, offset_feature, place);
    if (!movable && offset > 0) wrong(offset_key, "has no movable region");
  };
  set_axis("width_px", options.width_px, "Width", "x_px", options.x_px, "OffsetX");
  set_axis("height_px", options.height_px, "Height", "y_px", options.y_px, "OffsetY");
}

void Settings::set_frame_rate(double rate_hz) {
  if (rate_hz <= 0) return;
  const std::string key = "frame_rate_hz";
  if (!ask(key, arv_camera_is_frame_rate_available)) wrong(key, "has no frame rate to set");
  double low = 0;
  double high = 0;
  ask(key, arv_camera_get_frame_rate_bounds, &low, &high);
  if (low < high) check_range(key, rate_hz, low, high);
  ask(key, arv_camera_set_frame_rate, rate_hz);
  compare(key, rate_hz, ask(key, arv_camera_get_frame_rate));
}

void Settings::set_exposure(double exposure_us) {
  if (exposure_us <= 0) return;
  const std::string key = "exposure_us";
  if (!ask(key, arv_camera_is_exposure_time_available)) wrong(key, "has no exposure time to set");
  if (ask(key, arv_camera_is_exposure_auto_available))
    ask(key, arv_camera_set_exposure_time_auto, ARV_AUTO_OFF);
  double low = 0;
  double high = 0;
  ask(key, arv_camera_get_exposure_time_bounds, &low, &high);
  check_range(key, exposure_us, low, high);
  ask(key, arv_camera_set_exposure_time, exposure_us);
  compare(key, exposure_us, ask(key, arv_camera_get_exposure_time));
}

void Settings::set_gain(double gain_db) {
  if (gain_db < 0) return;
  const std::string key = "gain_db";
  if (!ask(key, arv_camera_is_gain_available)) wrong(key, "has no gain to set");
  if (ask(key, arv_camera_is_gain_auto_available)) ask(key, arv_camera_set_gain_auto, ARV_AUTO_OFF);
  double low = 0;
  double high = 0;
  ask(key, arv_camera_get_gain_bounds, &low, &high);
  check_range(key, gain_db, low, high);
  ask(key, arv_camera_set_gain, gain_db);
  compare(key, gain_db, ask(key, arv_camera_get_gain));
  if (!has("Gain"))
    notes.push_back(
        fmt::format("gain_db: the camera takes {} as its own gain steps, not dB", gain_db));
}

void Settings::set_trigger(Trigger trigger, const std::string& line) {
  if (trigger == Trigger::kAsIs) return;
  if (trigger == Trigger::kFree) {
    ask("trigger", arv_camera_clear_triggers);
    return;
  }
  const bool software = trigger == Trigger::kSoftware;
  const std::string key = software ? "trigger" : "trigger_line";
  const std::string source = software ? "Software" : line;
  guint count = 0;
  const Texts sources(ask(key, arv_camera_dup_available_trigger_sources, &count));
  if (!contains(sources, count, source))
    wrong(key, fmt::format("has no trigger source {}, only {}", source, joined(sources, count)));
  ask(key, arv_camera_set_trigger, source.c_str());
  const std::string done = text_or_empty(ask(key, arv_camera_get_trigger_source));
  if (done != source)
    notes.push_back(fmt::format("{}: asked {}, camera does {}", key, source, done));
}

void Settings::set_packets(const CameraOptions& options) {
  if (!arv_camera_is_gv_device(camera_)) return;
  const std::string size_key = "packet_size_bytes";
  if (options.packet_size_bytes > 0) {
    gint64 low = 0;
    gint64 high = 0;
    ask(size_key, arv_camera_get_integer_bounds, "GevSCPSPacketSize", &low, &high);
    check_range<gint64>(size_key, options.packet_size_bytes, low, high);
    ask(size_key, arv_camera_gv_set_packet_size, options.packet_size_bytes);
    compare<gint64>(size_key, options.packet_size_bytes,
                    ask(size_key, arv_camera_gv_get_packet_size));
  } else {
    ask(size_key, arv_camera_gv_auto_packet_size);
    notes.push_back(fmt::format("{}: {} negotiated with the camera", size_key,
                                ask(size_key, arv_camera_gv_get_packet_size)));
  }
  if (options.packet_delay_ns < 0) return;
  const std::string delay_key = "packet_delay_ns";
  ask(delay_key, arv_camera_gv_set_packet_delay, gint64{options.packet_delay_ns});
  compare<gint64>(delay_key, options.packet_delay_ns,
                  ask(delay_key, arv_camera_gv_get_packet_delay));
}

}  // namespace

std::vector<std::string> apply_settings(ArvCamera* camera, const std::string& camera_name,
                                        const CameraOptions& options) {
  Settings settings(camera, camera_name);
  for (const auto& [feature, value] : options.features) settings.set_feature(feature, value);
  settings.set_pixel_format(options.pixel_format);
  settings.set_region(options);
  settings.set_frame_rate(options.frame_rate_hz);  // Aravis clears triggers here.
  settings.set_exposure(options.exposure_us);
  settings.set_gain(options.gain_db);
  settings.set_trigger(options.trigger, options.trigger_line);
  settings.set_packets(options);
  // A camera that another program left in single-frame mode would send just one frame.
  AravisError error;
  arv_camera_set_acquisition_mode(camera, ARV_ACQUISITION_MODE_CONTINUOUS, error.out());
  return std::move(settings.notes);
}

const PixelCoding& read_pixel_coding(ArvCamera* camera, const std::string& camera_name) {
  AravisError error;
  const auto code = static_cast<std::uint32_t>(arv_camera_get_pixel_format(camera, error.out()));
  const PixelCoding* coding = error ? nullptr : find_pixel_coding(code);
  if (coding != nullptr) return *coding;
  guint count = 0;
  const std::unique_ptr<gint64[], GFree> offered(
      arv_camera_dup_available_pixel_formats(camera, &count, error.out()));
  std::string readable;
  for (guint i = 0; i < count; ++i)
    if (const auto* known = find_pixel_coding(static_cast<std::uint32_t>(offered[i])))
      readable += fmt::format("{}{}", readable.empty() ? "" : ", ", known->name);
  const std::string name =
      text_or_empty(arv_camera_get_pixel_format_as_string(camera, error.out()));
  throw Failure(fmt::format("camera.pixel_format: {} sends {}, which Curlew does not read; {}",
                            camera_name, name.empty() ? fmt::format("{:#010x}", code) : name,
                            readable.empty()
                                ? fmt::format("it has none of {}", known_pixel_codings())
                                : fmt::format("set one of {}", readable)));
}

FrameFormat read_frame_format(ArvCamera* camera, const std::string& camera_name,
                              const PixelCoding& coding) {
  gint x = 0, y = 0, cols = 0, rows = 0, binning_x = 1, binning_y = 1;
  AravisError error;
  arv_camera_get_region(camera, &x, &y, &cols, &rows, error.out());
  if (error)
    throw Failure(fmt::format("{} does not tell its region: {}", camera_name, error.text()));
  constexpr int kLargest_px = 65535;
  if (cols < 1 || cols > kLargest_px || rows < 1 || rows > kLargest_px)
    throw Failure(
        fmt::format("{} says that its frames have {} x {} pixels", camera_name, cols, rows));
  if (arv_camera_is_binning_available(camera, error.out()))
    arv_camera_get_binning(camera, &binning_x, &binning_y, error.out());
  if (binning_x != binning_y)
    throw Failure(fmt::format(
        "{} bins {} columns and {} rows, and pixels must be square: set BinningHorizontal and "
        "BinningVertical alike under [camera.features]",
        camera_name, binning_x, binning_y));
  FrameFormat format;
  format.rows = rows;
  format.cols = cols;
  format.pixel_type = coding.type();
  format.binning = binning_x > 0 ? binning_x : 1;
  format.offset_x_px = x * format.binning;  // GenICam counts binned pixels.
  format.offset_y_px = y * format.binning;
  return format;
}

}  // namespace curlew
