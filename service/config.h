// Config: everything a user can set, with its default.
#pragma once

#include <cstddef>
#include <set>
#include <string>
#include <vector>

#include "acquisition/camera_options.h"
#include "centroiding/centroid.h"
#include "detect/circulation_finder.h"
#include "detect/tracking/tracker_options.h"
#include "reconstruct/split.h"
#include "service/realtime/realtime.h"
#include "service/recorder/recorder.h"

namespace curlew {

enum class Threading {
  kInline,    ///< all stages on one thread: lowest latency on few cores
  kPerStage,  ///< one thread a stage, a queue between
};

/// [pipeline]
struct PipelineOptions {
  Threading threads = Threading::kInline;
  /// Frames that can be under way at once.
  std::size_t slots = 8;
  /// The most vortices reported a frame; more are counted as overflow.
  std::size_t max_vortices = 256;
  /// Pin the threads to these CPUs, in turn; empty: not pinned.
  std::vector<int> cpus;
  /// Results later than this after the frame was received are misses, counted and marked late;
  /// 0: no deadline.
  double deadline_us = 0.0;
};

/// How vortices are found.
enum class DetectMethod {
  kCirculation,  ///< where circulation stands out of the noise
  kWhitened,     ///< a matched filter on it, weighted by each lenslet's noise and darkness
  kClassifier,   ///< a trained network looks at the spots
};

/// [detect]: how vortices are found, and which candidates are reported as vortices.
struct DetectSettings : CirculationOptions {
  DetectMethod method = DetectMethod::kCirculation;
  /// The methods whitened and classifier do not report vortices that are less likely than this.
  double min_probability = 0.5;
};

/// [track]
struct TrackSettings : TrackerOptions {
  bool enabled = false;  ///< follow vortices from frame to frame, and believe what lasts
};

/// [split]
struct SplitSettings : SplitOptions {
  bool hidden_phase = false;  ///< make the whole phase: least squares and what the vortices add
};

/// [daemon]: what only `curlew run` needs.
struct DaemonOptions {
  std::string sensor;              ///< sensor file made by `curlew calibrate`
  std::string jsonl;               ///< one JSON object a frame; empty: none
  std::string control;             ///< socket for `curlew control`; empty: none
  std::string log_level = "info";  ///< debug, info, warning or error
};

/// One member for each section of the TOML file, under the section's name.
struct Config {
  CentroidOptions centroid;
  SplitSettings split;
  DetectSettings detect;
  TrackSettings track;
  PipelineOptions pipeline;
  DaemonOptions daemon;
  CameraOptions camera;  ///< [camera], and [usb] in camera.usb
  RealtimeOptions realtime;
  RecorderOptions recorder;
};

/// Reads a TOML file over the defaults. UsageError: missing file, bad syntax, an unknown key (with
/// its line), a value of the wrong type or out of range.
Config read_config(const std::string& path);

/// All values in TOML, as read_config takes them: what a run really used.
std::string config_text(const Config& config);

/// The sections in which they differ.
std::set<std::string> changed_sections(const Config& a, const Config& b);

/// 64-bit FNV-1a of config_text, in hexadecimal.
std::string config_hash(const Config& config);

/// The setting a word of the configuration stands for, for Threading and DetectMethod; UsageError
/// names `where` otherwise.
template <typename Enum>
Enum setting_from(const std::string& word, const std::string& where);

}  // namespace curlew
