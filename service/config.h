// Config: everything a user can set, with its default.
#pragma once

#include <cstddef>
#include <set>
#include <string>
#include <vector>

#include "acquisition/camera_options.h"
#include "centroiding/centroid.h"
#include "detect/tracker_options.h"
#include "detect/vortex_finder.h"
#include "reconstruct/split.h"
#include "service/realtime.h"
#include "service/recorder.h"

namespace curlew {

enum class Threading {
  kInline,    ///< all stages on one thread: lowest latency on few cores
  kPerStage,  ///< one thread a stage, a queue between
};

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

/// Which of a detector's candidates are vortices.
struct VortexOptions {
  DetectMethod method = DetectMethod::kCirculation;
  /// Of whitened and classifier: less likely ones are not reported.
  double min_probability = 0.5;
  bool track = false;  ///< follow them from frame to frame, and believe what lasts
};

/// What only the daemon, `curlew run`, needs.
struct DaemonOptions {
  std::string sensor;              ///< sensor file made by `curlew calibrate`
  std::string jsonl;               ///< one JSON object a frame; empty: none
  std::string control;             ///< socket for `curlew control`; empty: none
  std::string log_level = "info";  ///< debug, info, warning or error
};

struct Config {
  CentroidOptions centroid;
  SplitOptions split;
  DetectOptions detect;
  VortexOptions vortices;
  TrackerOptions tracker;
  bool hidden_phase = false;  ///< make the whole phase: least squares and what the vortices add
  PipelineOptions pipeline;
  DaemonOptions daemon;
  CameraOptions camera;
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
