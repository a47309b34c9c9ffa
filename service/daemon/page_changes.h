// This file declares what the page may change in the running daemon.
#pragma once

#include <array>
#include <string>

#include "service/daemon/daemon_connection.h"
#include "service/daemon/daemon_pipeline.h"
#include "service/daemon/live_calibration.h"

namespace curlew {

/// The settings that the page may change, as "section.key". Those of [camera] make the daemon
/// connect to the camera again.
inline constexpr std::array kPageSettings = {
    "centroid.method",
    "centroid.threshold_noise",
    "centroid.threshold_relative",
    "centroid.threshold_adu",
    "centroid.min_snr",
    "detect.method",
    "detect.false_alarms_per_frame",
    "detect.min_probability",
    "track.enabled",
    "split.hidden_phase",
    "camera.exposure_us",
    "camera.gain_db",
};

/// Does what the page asks for: {"set": "section.key", "value": V} changes a setting until the
/// daemon ends or reloads its configuration, and {"do": "trigger"}, {"do": "expose"}, {"do":
/// "record"} and {"do": "pause_recording"} act at once. {"do": "take_dark", "frames": N} and {"do":
/// "take_reference", "frames": N} begin what LiveCalibration does, of 100 frames if it is not said.
/// Everything is logged with `peer`, the address that it came from. Returns an empty text, or a
/// sentence on why nothing was changed.
struct PageTargets {
  DaemonPipeline& pipeline;
  DaemonConnection& connection;
  LiveCalibration& calibration;
};
std::string change_by_page(const PageTargets& targets, const std::string& body,
                           const std::string& peer);

}  // namespace curlew
