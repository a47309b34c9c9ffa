#include "service/bench/bench_comparison.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "core/error.h"
#include "service/bench/bench_timing.h"
#include "service/bench/timed_rounds.h"

namespace curlew {
namespace {

using Json = nlohmann::ordered_json;

struct Figure {
  double median_us = 0.0;
  std::vector<double> parts;  ///< µs, or reads of the frame
  bool over_read = false;
};

/// Returns the figure that this is, if it is one.
std::optional<Figure> figure_of(const Json& json) {
  if (!json.is_object() || !json.contains("median_us") || !json.contains("parts_us")) return {};
  const Json& parts = json["parts_us"];
  if (!json["median_us"].is_number() || !parts.is_array() || parts.empty()) return {};
  Figure figure{json["median_us"].get<double>(), {}, false};
  for (const Json& part : parts) {
    if (!part.is_number() || !(part.get<double>() > 0.0)) return {};
    figure.parts.push_back(part.get<double>());
  }
  return figure;
}

/// Returns the figure in units of the read, part by part.
Figure over(Figure figure, const std::optional<Figure>& read) {
  if (!read || read->parts.size() != figure.parts.size()) return figure;
  for (std::size_t i = 0; i < figure.parts.size(); ++i) figure.parts[i] /= read->parts[i];
  figure.over_read = true;
  return figure;
}

/// Returns what tells an entry of a list from the others, as its size.
std::string name_of_entry(const Json& entry) {
  std::string name;
  for (const char* key : {"rows", "cols", "window_px", "pixels", "vortices", "name"}) {
    if (!entry.is_object() || !entry.contains(key)) continue;
    const Json& value = entry[key];
    name += ' ';
    name += value.is_string() ? value.get<std::string>() : value.dump();
  }
  return name;
}

/// Gathers all figures below `json`, each by its name. read: the nearest one above.
void gather(const Json& json, const std::string& name, std::optional<Figure> read,
            std::map<std::string, Figure>& figures) {
  if (const auto figure = figure_of(json)) {
    figures[name] = over(*figure, read);
    return;
  }
  if (json.is_array()) {
    for (const Json& entry : json) gather(entry, name + name_of_entry(entry), read, figures);
  } else if (json.is_object()) {
    if (json.contains("read")) {
      if (const auto own = figure_of(json["read"])) read = own;
    }
    for (const auto& [key, value] : json.items()) {
      const bool is_read = key == "read";
      gather(value, name.empty() ? key : fmt::format("{} / {}", name, key),
             is_read ? std::optional<Figure>{} : read, figures);
    }
  }
}

/// Returns where the parts lie, from the lowest but one to the highest but one.
std::pair<double, double> range_of(std::vector<double> parts) {
  std::sort(parts.begin(), parts.end());
  return {parts[1], parts[parts.size() - 2]};
}

ComparedFigure compare(const std::string& name, const Figure& before, const Figure& now) {
  constexpr double kNotable = 0.03;
  ComparedFigure compared{name, before.median_us, now.median_us, 1.0, now.over_read, {}};
  compared.ratio = median(now.parts) / median(before.parts);
  if (before.parts.size() < kTimedParts || now.parts.size() < kTimedParts) {
    compared.change = FigureChange::kUnsure;
    return compared;
  }
  const auto [before_low, before_high] = range_of(before.parts);
  const auto [now_low, now_high] = range_of(now.parts);
  if (std::abs(compared.ratio - 1.0) <= kNotable) return compared;
  if (now_low > before_high) compared.change = FigureChange::kSlower;
  if (now_high < before_low) compared.change = FigureChange::kFaster;
  return compared;
}

const char* word_for(FigureChange change) {
  switch (change) {
    case FigureChange::kFaster:
      return "faster";
    case FigureChange::kSlower:
      return "slower";
    case FigureChange::kUnsure:
      return "too few rounds to tell";
    default:
      return "same";
  }
}

}  // namespace

std::vector<ComparedFigure> compare_figures(const Json& before, const Json& now) {
  std::map<std::string, Figure> old_figures;
  std::map<std::string, Figure> new_figures;
  gather(before, "", {}, old_figures);
  gather(now, "", {}, new_figures);
  std::vector<ComparedFigure> compared;
  for (const auto& [name, figure] : new_figures) {
    const auto old = old_figures.find(name);
    if (old != old_figures.end() && old->second.over_read == figure.over_read)
      compared.push_back(compare(name, old->second, figure));
  }
  return compared;
}

Json read_figures(const std::string& path) {
  constexpr std::size_t kMostBytes = std::size_t{16} << 20U;
  std::ifstream file(path, std::ios::binary);
  if (!file) throw Failure("cannot read " + path + ": give a file that --json made");
  std::string text(kMostBytes + 1, '\0');
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(file.gcount()));
  Json json = text.size() > kMostBytes ? Json() : Json::parse(text, nullptr, false);
  if (!json.is_object() || !json.contains("cases"))
    throw Failure(path + " holds no figures of a benchmark: give a file that --json made");
  return json;
}

Json comparison_json(const std::vector<ComparedFigure>& compared) {
  Json json = Json::array();
  for (const ComparedFigure& figure : compared) {
    json.push_back({{"name", figure.name},
                    {"before_us", figure.before_us},
                    {"now_us", figure.now_us},
                    {"ratio", figure.ratio},
                    {"over_read", figure.over_read},
                    {"verdict", word_for(figure.change)}});
  }
  return json;
}

std::string comparison_text(const std::vector<ComparedFigure>& compared) {
  std::string text = fmt::format("\n{:<52}{:>12}{:>12}{:>10}\n", "compared with before, us",
                                 "before", "now", "ratio");
  std::size_t changed = 0;
  bool any_over_read = false;
  for (const ComparedFigure& figure : compared) {
    const bool same = figure.change == FigureChange::kSame;
    changed += same ? 0 : 1;
    any_over_read = any_over_read || figure.over_read;
    text += fmt::format("{:<52}{:>12.1f}{:>12.1f}{:>9.3f}{}  {}\n", figure.name, figure.before_us,
                        figure.now_us, figure.ratio, figure.over_read ? "r" : " ",
                        same ? "" : word_for(figure.change));
  }
  text +=
      fmt::format("{} of {} figures have changed by more than noise.{}\n", changed, compared.size(),
                  any_over_read ? " r: in units of a read of the frame in the same run." : "");
  return text;
}

}  // namespace curlew
