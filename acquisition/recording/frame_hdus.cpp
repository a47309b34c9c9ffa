#include "acquisition/recording/frame_hdus.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <optional>
#include <string_view>
#include <utility>

#include "core/error.h"

namespace curlew {
namespace {

/// What the name of an image says about it.
enum class Named { kNothing, kFrames, kDark, kFlat, kBadPixels, kOther };

/// Holds an image that has pixels.
struct Candidate {
  int hdu = 0;
  std::string name{};   ///< in capitals; empty if it has none
  std::string place{};  ///< where on a mosaic of detectors the image belongs; mostly empty
  ImageInfo info{};

  bool is_frame_like() const { return info.shape.size() > 1; }
  std::int64_t planes() const {
    if (info.elements() == 0) return 0;
    return info.elements() / (info.shape.back() * info.shape[info.shape.size() - 2]);
  }
  bool is_like(const Candidate& other) const {
    return info.element == other.info.element && info.shape == other.info.shape &&
           info.has_undefined == other.info.has_undefined && place == other.place;
  }
};

using Candidates = std::vector<Candidate>;

std::string capitals(std::string text) {
  for (char& c : text) {
    if (c >= 'a' && c <= 'z') c = static_cast<char>(c - 'a' + 'A');
  }
  return text;
}

Named what_is_named(const std::string& name) {
  constexpr std::array<std::pair<std::string_view, Named>, 7> kParts{{{"DARK", Named::kDark},
                                                                      {"BIAS", Named::kDark},
                                                                      {"FLAT", Named::kFlat},
                                                                      {"BADPIX", Named::kBadPixels},
                                                                      {"MASK", Named::kBadPixels},
                                                                      {"WEIGHT", Named::kOther},
                                                                      {"ERROR", Named::kOther}}};
  constexpr std::array<std::pair<std::string_view, Named>, 12> kWords{{{"SCI", Named::kFrames},
                                                                       {"SCIENCE", Named::kFrames},
                                                                       {"FRAMES", Named::kFrames},
                                                                       {"PIXELS", Named::kFrames},
                                                                       {"BPM", Named::kBadPixels},
                                                                       {"DQ", Named::kBadPixels},
                                                                       {"ERR", Named::kOther},
                                                                       {"VAR", Named::kOther},
                                                                       {"STAT", Named::kOther},
                                                                       {"SIGMA", Named::kOther},
                                                                       {"WHT", Named::kOther},
                                                                       {"WGT", Named::kOther}}};
  for (const auto& [part, named] : kParts) {
    if (name.find(part) != std::string::npos) return named;
  }
  for (const auto& [word, named] : kWords) {
    // A number may follow, as in ERR2.
    if (name.starts_with(word) &&
        name.find_first_not_of("0123456789_", word.size()) == std::string::npos)
      return named;
  }
  return Named::kNothing;
}

Named name_of(ImageContent content) {
  switch (content) {
    case ImageContent::kDark:
      return Named::kDark;
    case ImageContent::kFlat:
      return Named::kFlat;
    case ImageContent::kBadPixels:
      return Named::kBadPixels;
    case ImageContent::kFrames:
      break;
  }
  return Named::kFrames;
}

Candidates list_images(FitsFile& file) {
  Candidates found;
  for (int hdu = 0; file.try_select(hdu); ++hdu) {
    if (!file.is_image()) continue;
    Candidate candidate{.hdu = hdu, .name = capitals(file.key_string("EXTNAME").value_or(""))};
    if (candidate.name == "UNFINISHED") continue;
    try {
      candidate.info = file.image();
      candidate.place = file.key_string("DETSEC").value_or("");
    } catch (const Failure&) {
      // A cube has all frames that there are, whatever was cut off behind it.
      if (std::any_of(found.begin(), found.end(),
                      [](const Candidate& c) { return c.is_frame_like() && c.planes() > 1; }))
        break;
      throw;
    }
    if (!candidate.info.shape.empty()) found.push_back(std::move(candidate));
  }
  return found;
}

std::string listing(const Candidates& images) {
  std::string text;
  for (const Candidate& image : images) {
    text += (text.empty() ? "" : ", ") + std::to_string(image.hdu);
    if (!image.name.empty()) text += " " + image.name;
    text += " (";
    for (std::size_t i = 0; i < image.info.shape.size(); ++i)
      text += (i == 0 ? "" : " x ") + std::to_string(image.info.shape[i]);
    text += ")";
  }
  return text;
}

std::string hdu_text(const Candidate& image) {
  return "HDU " + std::to_string(image.hdu) + (image.name.empty() ? "" : ", " + image.name);
}

// Keeps what the user named.
Candidates keep_selected(const FitsFile& file, const Candidates& all, const std::string& hdu) {
  int number = -1;
  const auto [end, error] = std::from_chars(hdu.data(), hdu.data() + hdu.size(), number);
  const bool is_number = error == std::errc() && end == hdu.data() + hdu.size();
  const std::string name = capitals(hdu);
  Candidates kept;
  for (const Candidate& image : all) {
    if (is_number ? image.hdu == number : image.name == name) kept.push_back(image);
  }
  if (kept.empty())
    throw Failure(file.path() + " has no image HDU " + hdu + "; its images are " + listing(all));
  return kept;
}

// Keeps those images whose names say that they are what is wanted; if there are none, those whose
// names do not say that they are something else.
Candidates keep_content(const Candidates& all, ImageContent content) {
  const Named wanted = name_of(content);
  Candidates exact;
  Candidates possible;
  for (const Candidate& image : all) {
    const Named named = what_is_named(image.name);
    if (named == wanted) exact.push_back(image);
    if (named == Named::kNothing || named == Named::kFrames) possible.push_back(image);
  }
  if (!exact.empty()) return exact;
  return possible.empty() ? all : possible;
}

bool all_alike(const Candidates& images) {
  return std::all_of(images.begin(), images.end(),
                     [&](const Candidate& image) { return image.is_like(images.front()); });
}

// Returns the images that are the frames; none if that is not plain.
Candidates choose(Candidates images, bool selected) {
  if (images.size() < 2) return images;
  if (std::any_of(images.begin(), images.end(),
                  [](const Candidate& image) { return image.is_frame_like(); }))
    std::erase_if(images, [](const Candidate& image) { return !image.is_frame_like(); });
  if (images.size() < 2) return images;
  if (images.front().is_frame_like() && all_alike(images) &&
      (selected || images.front().planes() == 1))
    return images;
  if (selected || !images.front().is_frame_like()) return {};
  std::erase_if(images, [](const Candidate& image) { return image.planes() < 2; });
  return images.size() == 1 ? images : Candidates{};
}

}  // namespace

FrameHdus find_frame_hdus(FitsFile& file, const FrameSelection& selection) {
  const Candidates all = list_images(file);
  if (all.empty())
    throw Failure(file.path() + " holds no image, neither in the primary nor in an extension");
  const bool selected = !selection.hdu.empty();
  const Candidates chosen = choose(
      selected ? keep_selected(file, all, selection.hdu) : keep_content(all, selection.content),
      selected);
  if (chosen.empty()) {
    throw Failure(file.path() + " holds several images, and nothing tells which are meant: " +
                  listing(all) + "; name one of them by its HDU (--hdu)");
  }
  FrameHdus result{.image = chosen.front().info};
  for (const Candidate& image : chosen) result.hdus.push_back(image.hdu);
  if (chosen.size() > 1) {
    result.note = file.path() + ": the frames are " + std::to_string(chosen.size()) +
                  " image extensions, from " + hdu_text(chosen.front()) + ", to " +
                  hdu_text(chosen.back()) + ".";
  } else if (all.size() > 1 && !selected) {
    result.note = file.path() + ": of the images " + listing(all) + ", " +
                  hdu_text(chosen.front()) + ", is read; --hdu names another.";
  }
  file.select(result.hdus.front());
  return result;
}

}  // namespace curlew
