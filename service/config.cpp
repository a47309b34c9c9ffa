#include "service/config.h"

#include <toml++/toml.h>

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <set>
#include <sstream>

#include "core/error.h"

namespace curlew {
namespace {

struct Range {
  double low;
  double high;
};
constexpr Range kNotNegative{0.0, 1e9};
constexpr Range kFraction{0.0, 1.0};

/// The one list of all settings: visits (section, key, value, range) of each.
template <typename ConfigType, typename Visitor>
void visit_config(ConfigType& config, Visitor&& visit) {
  auto& centroid = config.centroid;
  visit("centroid", "threshold_adu", centroid.threshold_adu, kNotNegative);
  visit("centroid", "threshold_relative", centroid.threshold_relative, Range{0.0, 0.99});
  visit("centroid", "threshold_noise", centroid.threshold_noise, kNotNegative);
  visit("centroid", "min_snr", centroid.min_snr, kNotNegative);
  visit("centroid", "edge_fraction", centroid.edge_fraction, Range{0.0, 0.25});
  visit("centroid", "max_bad_fraction", centroid.max_bad_fraction, kFraction);
  auto& split = config.split;
  visit("split", "weighted", split.weighted, kNotNegative);
  visit("split", "tolerance", split.tolerance, Range{1e-7, 0.1});
  visit("split", "max_iterations", split.max_iterations, Range{1, 100000});
  auto& detect = config.detect;
  visit("detect", "false_alarms_per_frame", detect.false_alarms_per_frame, Range{1e-12, 1e6});
  visit("detect", "min_circulation_rad", detect.min_circulation_rad, Range{1e-6, 100});
  visit("detect", "lobe_fraction", detect.lobe_fraction, Range{0.0, 0.99});
  auto& pipeline = config.pipeline;
  visit("pipeline", "threads", pipeline.threads, kNotNegative);
  visit("pipeline", "slots", pipeline.slots, Range{2, 4096});
  visit("pipeline", "max_vortices", pipeline.max_vortices, Range{1, 1e6});
  visit("pipeline", "cpus", pipeline.cpus, Range{0, 1023});
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
        throw UsageError(where(section.source()) + "unknown section '" + name +
                         "', known are centroid, split, detect, pipeline");
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
  void read(const toml::node& node, const std::string& key, Threading& value, Range) const {
    if (!node.is_string()) refuse(node, key, R"("inline" or "per_stage")");
    value = threading_from(*node.value<std::string>(), where(node.source()) + key);
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

 private:
  static std::ostringstream full_precision() {
    std::ostringstream text;
    text.precision(std::numeric_limits<double>::max_digits10);
    return text;
  }
  template <typename Number>
  void write(Number value) {
    text_ << value;
  }
  void write(bool value) { text_ << (value ? "true" : "false"); }
  void write(Threading value) {
    text_ << (value == Threading::kInline ? "\"inline\"" : "\"per_stage\"");
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

std::string config_hash(const Config& config) {
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  for (const char c : config_text(config))
    hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3ULL;
  std::ostringstream text;
  text << std::hex << hash;
  return text.str();
}

Threading threading_from(const std::string& word, const std::string& where) {
  if (word == "inline") return Threading::kInline;
  if (word == "per_stage") return Threading::kPerStage;
  throw UsageError(where + " must be inline or per_stage, not '" + word + "'");
}

}  // namespace curlew
