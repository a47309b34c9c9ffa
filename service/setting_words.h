// The words by which the configuration names the values of enumerations.
#pragma once

#include <array>
#include <string_view>

#include "centroiding/centroid_method.h"
#include "service/config.h"

namespace curlew {

/// A word of the configuration and the value that it stands for.
template <typename Enum>
struct Word {
  std::string_view text;
  Enum value;
};
template <typename Enum>
Word(const char*, Enum) -> Word<Enum>;
inline constexpr std::array kThreadingWords = {Word{"inline", Threading::kInline},
                                               Word{"team", Threading::kTeam}};
inline constexpr std::array kDetectMethodWords = {
    Word{"auto", DetectMethod::kAuto}, Word{"circulation", DetectMethod::kCirculation},
    Word{"whitened", DetectMethod::kWhitened}, Word{"classifier", DetectMethod::kClassifier}};
inline constexpr std::array kTriggerWords = {
    Word{"as_is", Trigger::kAsIs}, Word{"free", Trigger::kFree}, Word{"line", Trigger::kLine},
    Word{"software", Trigger::kSoftware}};
inline constexpr std::array kRecordWords = {Word{"off", RecordMode::kOff},
                                            Word{"continuous", RecordMode::kContinuous},
                                            Word{"trigger", RecordMode::kTrigger}};
inline constexpr std::array kStreamWords = {Word{"mask", PublishedStream::kMask},
                                            Word{"slopes", PublishedStream::kSlopes},
                                            Word{"flux", PublishedStream::kFlux},
                                            Word{"phase", PublishedStream::kPhase},
                                            Word{"whole_phase", PublishedStream::kWholePhase},
                                            Word{"circulation", PublishedStream::kCirculation},
                                            Word{"vortices", PublishedStream::kVortices},
                                            Word{"zernike", PublishedStream::kZernike},
                                            Word{"frame", PublishedStream::kFrame}};
inline constexpr auto kCentroidWords = [] {
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
constexpr const auto& words_of(PublishedStream) { return kStreamWords; }

}  // namespace curlew
