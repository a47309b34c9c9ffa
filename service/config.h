// Config holds everything that a user can set, with its default.
#pragma once

#include <cstddef>
#include <cstdint>
#include <set>
#include <string>
#include <variant>
#include <vector>

#include "acquisition/camera_options.h"
#include "acquisition/recording/provenance.h"
#include "centroiding/centroid.h"
#include "detect/circulation_finder.h"
#include "detect/tracking/tracker_options.h"
#include "reconstruct/split.h"
#include "service/metrics/metrics_options.h"
#include "service/page/page_options.h"
#include "service/publish/publish_options.h"
#include "service/realtime/realtime.h"
#include "service/recorder/recorder.h"
#include "service/results/growing_lines.h"

namespace curlew {

enum class Threading {
  kInline,  ///< all stages run on one thread
  /// Several threads take frames in turn, and those that have nothing to do help with the spots of
  /// the newest one.
  kTeam,
};

/// Section [pipeline].
struct PipelineOptions {
  Threading threads = Threading::kInline;
  /// At most this many frames are under way at once, and a team has no more threads.
  std::size_t slots = 8;
  /// At most this many vortices are reported in a frame. Those beyond are counted as overflow.
  std::size_t max_vortices = 256;
  /// The threads are pinned to these CPUs, in turn, and a team has as many. If there are none, they
  /// are not pinned, and a team has as many as the process may use CPUs, but at most four.
  std::vector<int> cpus;
  /// If the results come later than this after the frame was received, the frame is counted and
  /// marked as late. 0: there is no deadline.
  double deadline_us = 0.0;
};

/// The methods by which vortices are found.
enum class DetectMethod {
  kAuto,         ///< takes the best of the others that sensor and settings allow
  kCirculation,  ///< finds circulation that stands out of the noise
  /// applies a matched filter to the circulation, weighted by each lenslet's noise and darkness
  kWhitened,
  kClassifier,  ///< lets a trained network look at the spots
};

/// Section [detect]: how vortices are found, and which candidates are reported as vortices.
struct DetectSettings : CirculationOptions {
  DetectMethod method = DetectMethod::kAuto;
  /// The methods whitened and classifier report no vortex that is less probable than this.
  double min_probability = 0.5;
  /// Whether the classifier's larger network looks again at what the smaller one sees.
  bool review = true;
};

/// Section [track].
struct TrackSettings : TrackerOptions {
  /// Whether vortices are followed from frame to frame, and tracks that last are believed.
  bool enabled = false;
};

/// Section [split].
struct SplitSettings : SplitOptions {
  /// Whether the whole phase is made: least squares and what the vortices add.
  bool hidden_phase = false;
};

/// Section [daemon]: what only `curlew run` needs.
struct DaemonOptions {
  std::string sensor;              ///< the sensor file made by `curlew calibrate`
  std::string jsonl;               ///< where one JSON object a frame goes; empty: nowhere
  JsonLinesOptions lines;          ///< which frames get one, and when a new file begins
  std::string control;             ///< the socket for `curlew control`; empty: none
  std::string log_level = "info";  ///< debug, info, warning or error
};

/// Config has one member for each section of the TOML file, under the section's name.
struct Config {
  CentroidOptions centroid;
  SplitSettings split;
  DetectSettings detect;
  TrackSettings track;
  PipelineOptions pipeline;
  DaemonOptions daemon;
  CameraOptions camera;  ///< sections [camera], and [usb] in camera.usb
  RealtimeOptions realtime;
  RecorderOptions recorder;
  PublishOptions publish;
  MetricsOptions metrics;
  PageOptions page;
};

/// Reads a TOML file over the defaults. Throws UsageError if the file is missing, its syntax is
/// bad, a key is unknown (the error names the line), or a value has the wrong type or is out of
/// range.
Config read_config(const std::string& path);

/// One configuration of several.
struct NamedConfig {
  std::string name;  ///< letters, digits, - and _, for it becomes part of a file's name
  Config config;
};

/// Reads a TOML file with a table for each configuration, in the file's order, such as
///     [strict.detect]
///     false_alarms_per_frame = 0.001
/// What a table says goes over `base`. Throws UsageError as read_config() does, and for a section
/// that is none of [centroid], [detect], [split] and [track], for a name with other letters, and
/// for fewer than two configurations or more than 100.
std::vector<NamedConfig> read_sweep(const std::string& path, const Config& base);

/// A value as it may come from elsewhere than a file.
using SettingValue = std::variant<bool, std::int64_t, double, std::string>;

/// Returns the configuration with one setting changed. Throws UsageError, as read_config() does,
/// for a key that is unknown and for a value of the wrong type or out of range.
Config with_setting(Config config, const std::string& section, const std::string& key,
                    const SettingValue& value);

/// Returns the values of all settings as TOML that read_config accepts: what a run really used.
std::string config_text(const Config& config);

/// Returns the names of the sections in which the two configurations differ.
std::set<std::string> changed_sections(const Config& a, const Config& b);

/// Returns the 64-bit FNV-1a hash of config_text, in hexadecimal.
std::string config_hash(const Config& config);

/// Returns what a file made with this configuration says of its origin: this program, the
/// configuration's hash and its text.
Provenance provenance_of(const Config& config);

/// Returns the setting that a word of the configuration stands for. It exists for Threading and
/// DetectMethod. Throws UsageError, which names `where`, if no setting has this word.
template <typename Enum>
Enum setting_from(const std::string& word, const std::string& where);

}  // namespace curlew
