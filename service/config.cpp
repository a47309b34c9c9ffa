#include "service/config.h"

#include <toml++/toml.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <set>
#include <utility>

#include "centroiding/centroid_methods.h"
#include "core/error.h"
#include "core/printable.h"
#include "service/program/hash.h"
#include "service/program/version.h"
#include "service/setting_words.h"
#include "service/toml_settings.h"

namespace curlew {
namespace {

constexpr Range kNotNegative{0.0, 1e9};
constexpr Range kFraction{0.0, 1.0};

/// This is the one list of all settings. It calls visit(section, key, value, range) for each.
template <typename ConfigType, typename Visitor>
void visit_config(ConfigType& config, Visitor&& visit) {
  auto& centroid = config.centroid;
  visit("centroid", "method", centroid.method, kNotNegative);
  visit("centroid", "threshold_adu", centroid.threshold_adu, kNotNegative);
  visit("centroid", "threshold_relative", centroid.threshold_relative, Range{0.0, 0.99});
  visit("centroid", "threshold_noise", centroid.threshold_noise, kNotNegative);
  visit("centroid", "min_snr", centroid.min_snr, kNotNegative);
  visit("centroid", "follow_level", centroid.follow_level, kNotNegative);
  visit("centroid", "measure_ahead", centroid.measure_ahead, kNotNegative);
  visit("centroid", "follow_windows", centroid.follow_windows, kNotNegative);
  visit("centroid", "edge_fraction", centroid.edge_fraction, Range{0.0, 0.25});
  visit("centroid", "max_bad_fraction", centroid.max_bad_fraction, kFraction);
  visit("centroid", "spot_sigma_px", centroid.spot_sigma_px, Range{0.0, kMaxMethodWindow});
  visit("centroid", "reference_pull", centroid.reference_pull, kNotNegative);
  visit("centroid", "brightest_pixels", centroid.brightest_pixels, Range{0, kMaxBrightestPixels});
  auto& split = config.split;
  visit("split", "hidden_phase", split.hidden_phase, kNotNegative);
  visit("split", "weighted", split.weighted, kNotNegative);
  visit("split", "tolerance", split.tolerance, Range{1e-7, 0.1});
  visit("split", "max_iterations", split.max_iterations, Range{1, 100000});
  auto& detect = config.detect;
  visit("detect", "method", detect.method, kNotNegative);
  visit("detect", "false_alarms_per_frame", detect.false_alarms_per_frame, Range{1e-12, 1e6});
  visit("detect", "min_circulation_rad", detect.min_circulation_rad, Range{1e-6, 100});
  visit("detect", "lobe_fraction", detect.lobe_fraction, Range{0.0, 0.99});
  visit("detect", "min_probability", detect.min_probability, Range{1e-6, 0.999999});
  visit("detect", "review", detect.review, kNotNegative);
  auto& track = config.track;
  visit("track", "enabled", track.enabled, kNotNegative);
  visit("track", "false_tracks_per_frame", track.false_tracks_per_frame, Range{1e-12, 1e3});
  visit("track", "min_probability", track.min_probability, Range{1e-6, 1.0});
  visit("track", "min_probability_single", track.min_probability_single, Range{1e-6, 1.0});
  visit("track", "longest_gap_frames", track.longest_gap_frames, Range{2.0, 1e6});
  auto& pipeline = config.pipeline;
  visit("pipeline", "threads", pipeline.threads, kNotNegative);
  visit("pipeline", "slots", pipeline.slots, Range{2, 4096});
  visit("pipeline", "max_vortices", pipeline.max_vortices, Range{1, 1e6});
  visit("pipeline", "cpus", pipeline.cpus, Range{0, 1023});
  visit("pipeline", "deadline_us", pipeline.deadline_us, kNotNegative);
  auto& daemon = config.daemon;
  visit("daemon", "sensor", daemon.sensor, kNotNegative);
  visit("daemon", "jsonl", daemon.jsonl, kNotNegative);
  visit("daemon", "jsonl_max_mb", daemon.lines.max_mb, Range{0, 1e6});
  visit("daemon", "jsonl_max_s", daemon.lines.max_s, Range{0, 1e7});
  visit("daemon", "jsonl_keep_files", daemon.lines.keep_files, Range{0, 1000});
  visit("daemon", "jsonl_every_nth", daemon.lines.every_nth, Range{1, 1e9});
  visit("daemon", "jsonl_vortices_only", daemon.lines.vortices_only, kNotNegative);
  visit("daemon", "jsonl_zernike", daemon.lines.zernike, kNotNegative);
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
  visit("camera", "auto_exposure", camera.auto_exposure, kNotNegative);
  visit("camera", "exposure_target", camera.exposure_target, Range{0.05, 0.9});
  visit("camera", "max_exposure_us", camera.max_exposure_us, Range{1, 1e9});
  visit("camera", "auto_exposure_recording", camera.auto_exposure_recording, kNotNegative);
  visit("camera", "gain_db", camera.gain_db, Range{-1, 1000});
  visit("camera", "frame_rate_hz", camera.frame_rate_hz, Range{0, 1e6});
  visit("camera", "readout_us", camera.readout_us, Range{0, 1e7});
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
  visit("recorder", "trigger_min_probability", recorder.trigger_min_probability, kFraction);
  visit("recorder", "trigger_tracked_only", recorder.trigger_tracked_only, kNotNegative);
  visit("recorder", "memory_mb", recorder.memory_mb, Range{1, 1e6});
  visit("recorder", "max_file_mb", recorder.max_file_mb, Range{1, 1e6});
  visit("recorder", "max_file_s", recorder.max_file_s, Range{1, 1e6});
  visit("recorder", "min_free_mb", recorder.min_free_mb, Range{0, 1e7});
  visit("recorder", "compress", recorder.compress, kNotNegative);
  auto& publish = config.publish;
  visit("publish", "streams", publish.streams, kNotNegative);
  visit("publish", "prefix", publish.prefix, kNotNegative);
  visit("publish", "folder", publish.folder, kNotNegative);
  auto& metrics = config.metrics;
  visit("metrics", "listen", metrics.listen, kNotNegative);
  visit("metrics", "beyond_loopback", metrics.beyond_loopback, kNotNegative);
  auto& page = config.page;
  visit("page", "listen", page.listen, kNotNegative);
  visit("page", "token_file", page.token_file, kNotNegative);
  visit("page", "control", page.control, kNotNegative);
}

// The parser goes down one level of the stack for every level of nesting, and a dotted key nests
// without end. A line's dots bound its levels, whatever stands in quotes.
constexpr std::uintmax_t kMaxFile_bytes = 1'000'000;
constexpr std::ptrdiff_t kMaxDots = 40;

/// Returns the text of a configuration file. Throws UsageError where the file is beyond reason.
std::string read_text(const std::string& path) {
  if (!std::filesystem::is_regular_file(path))
    throw UsageError(path + ": no such configuration file");
  std::ifstream file(path, std::ios::binary);
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  if (error) throw UsageError(path + ": it cannot be read");
  std::string text(std::min(size, kMaxFile_bytes) + 1, '\0');
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  if (!file.is_open() || file.bad()) throw UsageError(path + ": it cannot be read");
  text.resize(static_cast<std::size_t>(file.gcount()));
  if (text.size() > kMaxFile_bytes)
    throw UsageError(path + ": it is larger than 1 MB, which no configuration needs");
  std::istringstream lines(text);
  std::string line;
  for (int number = 1; std::getline(lines, line); ++number)
    if (std::count(line.begin(), line.end(), '.') > kMaxDots)
      throw UsageError(path + ":" + std::to_string(number) + ": the line has more than " +
                       std::to_string(kMaxDots) + " dots; keys must not nest that deeply");
  return text;
}

toml::table parse_file(const std::string& path) {
  const std::string text = read_text(path);
  try {
    return toml::parse(text, path);
  } catch (const toml::parse_error& error) {
    throw UsageError(path + ":" + std::to_string(error.source().begin.line) + ": " +
                     printable(error.description()));
  }
}

/// Puts what the table says over the configuration.
void read_over(const std::string& path, toml::table& table, Config& config) {
  TomlReader reader(path, table);
  visit_config(config, reader);
  reader.refuse_unknown();
}

/// Returns one configuration of a sweep, whose table has this name.
NamedConfig read_variant(const std::string& path, const toml::key& name, toml::node& node,
                         const Config& base) {
  const std::string where = path + ":" + std::to_string(name.source().begin.line) + ": ";
  constexpr std::string_view kAllowed =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_";
  constexpr std::size_t kLongest = 64;
  NamedConfig variant{std::string(name.str()), base};
  if (variant.name.empty() || variant.name.size() > kLongest ||
      variant.name.find_first_not_of(kAllowed) != std::string::npos)
    throw UsageError(where +
                     "a configuration's name must be of letters, digits, - and _, at most " +
                     std::to_string(kLongest) + " of them");
  toml::table* table = node.as_table();
  if (table == nullptr)
    throw UsageError(where + variant.name + " must be a table of sections, such as [" +
                     variant.name + ".detect]");
  read_over(path, *table, variant.config);
  std::set<std::string> others = changed_sections(base, variant.config);
  for (const char* varied : {"centroid", "detect", "split", "track"}) others.erase(varied);
  if (!others.empty())
    throw UsageError(where + "a sweep varies [centroid], [detect], [split] and [track], and not [" +
                     *others.begin() + "]: put that into --config");
  return variant;
}

}  // namespace

Config read_config(const std::string& path) {
  toml::table table = parse_file(path);
  Config config;
  read_over(path, table, config);
  return config;
}

std::vector<NamedConfig> read_sweep(const std::string& path, const Config& base) {
  constexpr std::size_t kMost = 100;
  toml::table table = parse_file(path);
  if (table.size() < 2 || table.size() > kMost)
    throw UsageError(path + ": a sweep has from 2 to " + std::to_string(kMost) +
                     " configurations, each a table of its own, and this has " +
                     std::to_string(table.size()));
  std::vector<std::pair<toml::source_position, NamedConfig>> placed;
  for (auto&& [name, node] : table)
    placed.emplace_back(name.source().begin, read_variant(path, name, node, base));
  std::stable_sort(placed.begin(), placed.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<NamedConfig> variants;
  variants.reserve(placed.size());
  for (auto& [place, variant] : placed) variants.push_back(std::move(variant));
  return variants;
}

Config with_setting(Config config, const std::string& section, const std::string& key,
                    const SettingValue& value) {
  toml::table keys;
  std::visit([&](const auto& known) { keys.insert(key, known); }, value);
  toml::table table;
  table.insert(section, std::move(keys));
  read_over("change", table, config);
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

std::string config_hash(const Config& config) { return hash_text(config_text(config)); }

Provenance provenance_of(const Config& config) {
  Provenance provenance(kProgram);
  provenance.configuration_hash = config_hash(config);
  provenance.history = lines_of(config_text(config));
  provenance.history.insert(provenance.history.begin(), "configuration (TOML), all settings:");
  return provenance;
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
