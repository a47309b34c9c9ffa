// This file declares the messages that the page gets: JSON and arrays in one.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "service/page/frame_copy.h"
#include "service/results/wavefront_meter.h"
#include "service/stages.h"

namespace curlew {

/// A message is, little-endian: the length of its JSON as u32, the JSON, and the arrays that its
/// key "arrays" lists in order. JSON and arrays are each padded with blanks or zeros so that every
/// array begins at a multiple of 4 bytes.
using PageMessage = std::shared_ptr<const std::string>;

/// What the messages of one plan's frames have in common.
class PagePlan {
 public:
  /// number: names the plan to the page. title: says where the frames come from.
  PagePlan(std::shared_ptr<const Plan> plan, std::int64_t number, std::string title);

  const Plan* plan() const { return plan_.get(); }
  std::int64_t number() const { return number_; }
  void number(std::int64_t number) { number_ = number; }

  /// Returns what the page has to know of sensor and plan: grid, optics, detector, configuration,
  /// windows and reference spots.
  PageMessage description() const;

  /// Returns a frame with its results. tail: further JSON, empty or beginning with a comma.
  PageMessage frame(const FrameCopy& copy, const std::string& tail);

  /// Returns what the page charts over time of a frame, an object with frame, vortices, rms,
  /// scintillation, lost and tracks: a list of [track, charge, x, y]; null stands for what is not
  /// known.
  std::string point(const FrameCopy& copy);

 private:
  std::shared_ptr<const Plan> plan_;
  std::int64_t number_;
  std::string title_;
  WavefrontMeter meter_;
};

/// Returns a message without arrays. json: an object.
PageMessage plain_message(std::string json);

}  // namespace curlew
