#include "service/config.h"

#include <toml++/toml.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <set>
#include <sstream>
#include <string_view>
#include <utility>

#include "centroiding/centroid_methods.h"
#include "core/error.h"
#include "service/hash.h"

namespace curlew {
namespace {

struct Range {
  double low;
  double high;
};
constexpr Range kNotNegative{0.0, 1e9};
constexpr Range kFraction{0.0, 1.0};

/// The words a setting of an enumeration takes.
template <typename Enum>
struct Word {
  std::string_view text;
  Enum value;
};
template <typename Enum>
Word(const char*, Enum) -> Word<Enum>;
constexpr std::array kThreadingWords = {Word{"inline", Threading::kInline},
                                        Word{"per_stage", Threading::kPerStage}};
constexpr std::array kDetectMethodWords = {Word{"circulation", DetectMethod::kCirculation},
                                           Word{"whitened", DetectMethod::kWhitened},
                                           Word{"classifier", DetectMethod::kClassifier}};
constexpr std::array kTriggerWords = {Word{"as_is", Trigger::kAsIs}, Word{"free", Trigger::kFree},
                                      Word{"line", Trigger::kLine},
                                      Word{"software", Trigger::kSoftware}};
constexpr std::array kRecordWords = {Word{"off", RecordMode::kOff},
                                     Word{"continuous", RecordMode::kContinuous},
                                     Word{"trigger", RecordMode::kTrigger}};
constexpr auto kCentroidWords = [] {
  std::array<Word<CentroidMethod>, kCentroidMethodNames.size()> words{};
  for (std::size_t i = 0; i < words.size(); ++i)
    words[i] = {kCentroidMethodNames[i], static_cast<CentroidMethod>(i)};
  return words;
}();
constexpr const auto& words_of(CentroidMethod) { return kCentroidWords; }
constexpr const auto& words_of(Threading) { return kThreadingWords; }
constexpr const auto& words_of(DetectMethod) { return kDetectMethodWords; }
constexpr const auto& words_of(Trigger) { return kTriggerWords; }
constexpr const auto& words_of(RecordMode) { return kRecordWords; }

/// The one list of all settings: visits (section, key, value, range) of each.
template <typename ConfigType, typename Visitor>
void visit_config(ConfigType& config, Visitor&& visit) {
  auto& centroid = config.centroid;
  visit("centroid", "method", centroid.method, kNotNegative);
  visit("centroid", "threshold_adu", centroid.threshold_adu, kNotNegative);
  visit("centroid", "threshold_relative", centroid.threshold_relative, Range{0.0, 0.99});
  visit("centroid", "threshold_noise", centroid.threshold_noise, kNotNegative);
  visit("centroid", "min_snr", centroid.min_snr, kNotNegative);
  visit("centroid", "edge_fraction", centroid.edge_fraction, Range{0.0, 0.25});
  visit("centroid", "max_bad_fraction", centroid.max_bad_fraction, kFraction);
  visit("centroid", "spot_sigma_px", centroid.spot_sigma_px, Range{0.0, kMaxMethodWindow});
  visit("centroid", "reference_pull", centroid.reference_pull, kNotNegative);
  visit("centroid", "brightest_pixels", centroid.brightest_pixels, Range{0, kMaxBrightestPixels});
  auto& split = config.split;
  visit("split", "hidden_phase", config.hidden_phase, kNotNegative);
  visit("split", "weighted", split.weighted, kNotNegative);
  visit("split", "tolerance", split.tolerance, Range{1e-7, 0.1});
  visit("split", "max_iterations", split.max_iterations, Range{1, 100000});
  auto& detect = config.detect;
  auto& vortices = config.vortices;
  visit("detect", "method", vortices.method, kNotNegative);
  visit("detect", "false_alarms_per_frame", detect.false_alarms_per_frame, Range{1e-12, 1e6});
  visit("detect", "min_circulation_rad", detect.min_circulation_rad, Range{1e-6, 100});
  visit("detect", "lobe_fraction", detect.lobe_fraction, Range{0.0, 0.99});
  visit("detect", "min_probability", vortices.min_probability, Range{1e-6, 0.999999});
  auto& tracker = config.tracker;
  visit("track", "enabled", vortices.track, kNotNegative);
  visit("track", "false_tracks_per_frame", tracker.false_tracks_per_frame, Range{1e-12, 1e3});
  visit("track", "min_probability", tracker.min_probability, Range{1e-6, 1.0});
  visit("track", "min_probability_single", tracker.min_probability_single, Range{1e-6, 1.0});
  visit("track", "longest_gap_frames", tracker.longest_gap_frames, Range{2.0, 1e6});
  auto& pipeline = config.pipeline;
  visit("pipeline", "threads", pipeline.threads, kNotNegative);
  visit("pipeline", "slots", pipeline.slots, Range{2, 4096});
  visit("pipeline", "max_vortices", pipeline.max_vortices, Range{1, 1e6});
  visit("pipeline", "cpus", pipeline.cpus, Range{0, 1023});
  visit("pipeline", "deadline_us", pipeline.deadline_us, kNotNegative);
  auto& daemon = config.daemon;
  visit("daemon", "sensor", daemon.sensor, kNotNegative);
  visit("daemon", "jsonl", daemon.jsonl, kNotNegative);
  visit("daemon", "control", daemon.control, kNotNegative);
  visit("daemon", "log_level", daemon.log_level, kNotNegative);
  auto& camera = config.camera;
  visit("camera", "source", camera.source, kNotNegative);
  visit("camera", "x_px", camera.x_px, Range{-1, 65535});
  visit("camera", "y_px", camera.y_px, Range{-1, 65535});
  visit("camera", "width_px", camera.width_px, Range{0, 65535});
  visit("camera", "height_px", camera.height_px, Range{0, 65535});
  visit("camera", "pixel_format", camera.pixel_format, kNotNegative);
  visit("camera", "exposure_us", camera.exposure_us, kNotNegative);
  visit("camera", "gain_db", camera.gain_db, Range{-1, 1000});
  visit("camera", "frame_rate_hz", camera.frame_rate_hz, Range{0, 1e6});
  visit("camera", "trigger", camera.trigger, kNotNegative);
  visit("camera", "trigger_line", camera.trigger_line, kNotNegative);
  visit("camera", "packet_size_bytes", camera.packet_size_bytes, Range{0, 65535});
  visit("camera", "packet_delay_ns", camera.packet_delay_ns, Range{-1, 1e9});
  visit("camera", "socket_buffer_bytes", camera.socket_buffer_bytes, Range{65536, 1 << 30});
  visit("camera", "packet_resend", camera.packet_resend, kNotNegative);
  visit("camera", "frame_retention_us", camera.frame_retention_us, Range{1000, 1e7});
  visit("camera", "buffers", camera.buffers, Range{3, 1000});
  visit("camera", "timeout_s", camera.timeout_s, Range{-1, 1e6});
  visit("camera", "max_backoff_s", camera.max_backoff_s, Range{0.05, 3600});
  visit("camera", "features", camera.features, kNotNegative);
  auto& usb = config.camera.usb;
  visit("usb", "interface", usb.interface_number, Range{0, 255});
  visit("usb", "alternate_setting", usb.alternate_setting, Range{0, 255});
  visit("usb", "endpoint", usb.endpoint, Range{0x81, 0x8f});
  visit("usb", "rows", usb.rows, Range{0, 65535});
  visit("usb", "cols", usb.cols, Range{0, 65535});
  visit("usb", "bits", usb.bits, Range{8, 16});
  visit("usb", "header_bytes", usb.header_bytes, Range{0, 1 << 20});
  visit("usb", "trailer_bytes", usb.trailer_bytes, Range{0, 1 << 20});
  visit("usb", "sync", usb.sync, kNotNegative);
  visit("usb", "sequence_offset", usb.sequence_offset, Range{-1, 1 << 20});
  visit("usb", "transfer_bytes", usb.transfer_bytes, Range{512, 1 << 24});
  visit("usb", "transfers", usb.transfers, Range{2, 1024});
  auto& realtime = config.realtime;
  visit("realtime", "priority", realtime.priority, Range{0, 99});
  visit("realtime", "camera_priority", realtime.camera_priority, Range{0, 99});
  visit("realtime", "camera_cpus", realtime.camera_cpus, Range{0, 1023});
  visit("realtime", "lock_memory", realtime.lock_memory, kNotNegative);
  visit("realtime", "huge_pages", realtime.huge_pages, kNotNegative);
  visit("realtime", "max_cpu_wakeup_us", realtime.max_cpu_wakeup_us, Range{-1, 1e6});
  auto& recorder = config.recorder;
  visit("recorder", "mode", recorder.mode, kNotNegative);
  visit("recorder", "folder", recorder.folder, kNotNegative);
  visit("recorder", "before_s", recorder.before_s, Range{0, 1e6});
  visit("recorder", "after_s", recorder.after_s, Range{0, 1e6});
  visit("recorder", "trigger_on_vortex", recorder.trigger_on_vortex, kNotNegative);
  visit("recorder", "memory_mb", recorder.memory_mb, Range{1, 1e6});
  visit("recorder", "max_file_mb", recorder.max_file_mb, Range{1, 1e6});
  visit("recorder", "max_file_s", recorder.max_file_s, Range{1, 1e6});
  visit("recorder", "min_free_mb", recorder.min_free_mb, Range{0, 1e7});
  visit("recorder", "compress", recorder.compress, kNotNegative);
}

std::ostringstream full_precision() {
  std::ostringstream text;
  text.precision(std::numeric_limits<double>::max_digits10);
  return text;
}

class TomlReader {
 public:
  TomlReader(const std::string& path, toml::table& table) : path_(path), table_(table) {}

  template <typename T>
  void operator()(const char* section, const char* key, T& value, Range range) {
    known_.insert(std::string(section) + "." + key);
    sections_.insert(section);
    const toml::node* node = table_[section][key].node();
    if (node == nullptr) return;
    read(*node, std::string(section) + "." + key, value, range);
  }

  void refuse_unknown() const {
    for (const auto& [section, node] : table_) {
      const std::string name(section.str());
      if (sections_.contains(name) && !node.is_table()) refuse(node, name, "a section");
      if (!sections_.contains(name))
        throw UsageError(where(section.source()) + "unknown section '" + name + "', known are " +
                         known_sections());
      for (const auto& [key, value] : *node.as_table())
        if (!known_.contains(name + "." + std::string(key.str())))
          throw UsageError(where(key.source()) + "unknown key '" + std::string(key.str()) +
                           "' in [" + name + "]" + keys_of(name));
    }
  }

 private:
  std::string where(const toml::source_region& source) const {
    return path_ + ":" + std::to_string(source.begin.line) + ": ";
  }
  std::string known_sections() const {
    std::string text;
    for (const std::string& section : sections_)
      text.append(text.empty() ? "" : ", ").append(section);
    return text;
  }
  std::string keys_of(const std::string& section) const {
    std::string text;
    for (const std::string& key : known_)
      if (key.rfind(section + ".", 0) == 0)
        text += (text.empty() ? ", known are " : ", ") + key.substr(section.size() + 1);
    return text;
  }
  [[noreturn]] void refuse(const toml::node& node, const std::string& key,
                           const std::string& wanted) const {
    throw UsageError(where(node.source()) + key + " must be " + wanted);
  }
  double number(const toml::node& node, const std::string& key, Range range) const {
    const auto value = node.value<double>();
    if (!value || node.is_boolean() || !(*value >= range.low && *value <= range.high)) {
      std::ostringstream wanted;
      wanted << "a number from " << range.low << " to " << range.high;
      refuse(node, key, wanted.str());
    }
    return *value;
  }
  template <typename Integer>
  Integer integer(const toml::node& node, const std::string& key, Range range) const {
    if (!node.is_integer()) refuse(node, key, "a whole number");
    return static_cast<Integer>(number(node, key, range));
  }

  void read(const toml::node& node, const std::string& key, double& value, Range range) const {
    value = number(node, key, range);
  }
  void read(const toml::node& node, const std::string& key, int& value, Range range) const {
    value = integer<int>(node, key, range);
  }
  void read(const toml::node& node, const std::string& key, std::size_t& value, Range range) const {
    value = integer<std::size_t>(node, key, range);
  }
  void read(const toml::node& node, const std::string& key, bool& value, Range) const {
    if (!node.is_boolean()) refuse(node, key, "true or false");
    value = *node.value<bool>();
  }
  void read(const toml::node& node, const std::string& key, std::int64_t& value,
            Range range) const {
    value = integer<std::int64_t>(node, key, range);
  }
  void read(const toml::node& node, const std::string& key, std::string& value, Range) const {
    if (!node.is_string()) refuse(node, key, "a text in quotes");
    value = *node.value<std::string>();
  }
  template <typename Enum>
  requires std::is_enum_v<Enum>
  void read(const toml::node& node, const std::string& key, Enum& value, Range) const {
    std::string known;
    for (const auto& word : words_of(value)) {
      if (node.is_string() && *node.value<std::string_view>() == word.text) {
        value = word.value;
        return;
      }
      known.append(known.empty() ? "\"" : ", \"").append(word.text).append("\"");
    }
    refuse(node, key, "one of " + known);
  }
  /// A table of names and texts, numbers or truth values, kept as the texts a camera takes, and in
  /// the file's order: a selector comes before what it selects.
  void read(const toml::node& node, const std::string& key,
            std::vector<std::pair<std::string, std::string>>& value, Range) const {
    if (!node.is_table()) refuse(node, key, "a table of names and values");
    value.clear();
    std::vector<toml::source_position> places;
    for (const auto& [name, element] : *node.as_table()) {
      std::ostringstream text = full_precision();
      if (const auto number = element.value_exact<std::int64_t>())
        text << *number;
      else if (const auto real = element.value_exact<double>())
        text << *real;
      else if (const auto truth = element.value_exact<bool>())
        text << (*truth ? "true" : "false");
      else if (const auto word = element.value_exact<std::string>())
        text << *word;
      else
        refuse(element, key + "." + std::string(name.str()), "a text, a number, true or false");
      const auto place = std::upper_bound(places.begin(), places.end(), name.source().begin);
      value.emplace(value.begin() + (place - places.begin()), name.str(), text.str());
      places.insert(place, name.source().begin);
    }
  }
  void read(const toml::node& node, const std::string& key, std::vector<int>& value,
            Range range) const {
    if (!node.is_array()) refuse(node, key, "a list of whole numbers");
    value.clear();
    for (const toml::node& element : *node.as_array())
      value.push_back(integer<int>(element, key, range));
  }

  const std::string& path_;
  toml::table& table_;
  std::set<std::string> known_;
  std::set<std::string> sections_;
};

class TomlWriter {
 public:
  template <typename T>
  void operator()(const char* section, const char* key, const T& value, Range) {
    if (section_ != section) text_ << (section_.empty() ? "[" : "\n[") << section << "]\n";
    section_ = section;
    text_ << key << " = ";
    write(value);
    text_ << "\n";
  }
  std::string text() const { return text_.str(); }

  template <typename T>
  static std::string value_text(const T& value) {
    TomlWriter writer;
    writer.write(value);
    return writer.text();
  }

 private:
  template <typename Number>
  requires std::is_arithmetic_v<Number>
  void write(Number value) { text_ << value; }
  void write(bool value) { text_ << (value ? "true" : "false"); }
  template <typename Enum>
  requires std::is_enum_v<Enum>
  void write(Enum value) {
    for (const auto& word : words_of(value))
      if (word.value == value) write(std::string(word.text));
  }
  void write(const std::string& value) {
    std::ostringstream quoted;
    quoted << toml::value<std::string>(value);
    text_ << quoted.str();
  }
  void write(const std::vector<std::pair<std::string, std::string>>& values) {
    text_ << "{";
    const char* before = " ";
    for (const auto& [name, value] : values) {
      text_ << std::exchange(before, ", ");
      write(name);
      text_ << " = ";
      write(value);
    }
    text_ << (values.empty() ? "}" : " }");
  }
  void write(const std::vector<int>& values) {
    text_ << "[";
    for (std::size_t i = 0; i < values.size(); ++i) text_ << (i > 0 ? ", " : "") << values[i];
    text_ << "]";
  }

  std::ostringstream text_ = full_precision();
  std::string section_;
};

}  // namespace

Config read_config(const std::string& path) {
  if (!std::filesystem::is_regular_file(path))
    throw UsageError(path + ": no such configuration file");
  toml::table table;
  try {
    table = toml::parse_file(path);
  } catch (const toml::parse_error& error) {
    throw UsageError(path + ":" + std::to_string(error.source().begin.line) + ": " +
                     std::string(error.description()));
  }
  Config config;
  TomlReader reader(path, table);
  visit_config(config, reader);
  reader.refuse_unknown();
  return config;
}

std::string config_text(const Config& config) {
  TomlWriter writer;
  visit_config(config, writer);
  return writer.text();
}

std::set<std::string> changed_sections(const Config& a, const Config& b) {
  std::vector<std::pair<std::string, std::string>> values;  // section, value
  visit_config(a, [&](const char* section, const char*, const auto& value, Range) {
    values.emplace_back(section, TomlWriter::value_text(value));
  });
  std::set<std::string> changed;
  std::size_t next = 0;
  visit_config(b, [&](const char* section, const char*, const auto& value, Range) {
    if (values[next++].second != TomlWriter::value_text(value)) changed.insert(section);
  });
  return changed;
}

std::string config_hash(const Config& config) {
  std::ostringstream text;
  text << std::hex << fnv1a(config_text(config));
  return text.str();
}

template <typename Enum>
Enum setting_from(const std::string& word, const std::string& where) {
  std::string wanted;
  for (const auto& known : words_of(Enum{})) {
    if (known.text == word) return known.value;
    wanted.append(wanted.empty() ? "" : " or ").append(known.text);
  }
  throw UsageError(where + " must be " + wanted + ", not '" + word + "'");
}
template Threading setting_from<Threading>(const std::string&, const std::string&);
template DetectMethod setting_from<DetectMethod>(const std::string&, const std::string&);

}  // namespace curlew
