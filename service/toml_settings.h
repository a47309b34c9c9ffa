// Reads settings from TOML and writes them as TOML, one at a time: (section, key, value, range).
#pragma once

#include <toml++/toml.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <set>
#include <sstream>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "core/error.h"
#include "service/setting_words.h"

namespace curlew {

/// The range in which a number must lie.
struct Range {
  double low;
  double high;
};

/// Returns a stream that writes all digits needed to read the same number back.
inline std::ostringstream full_precision() {
  std::ostringstream text;
  text.precision(std::numeric_limits<double>::max_digits10);
  return text;
}

/// Visits every setting with the table of a file, and then refuses keys that no setting has. Throws
/// UsageError, which names file, line and key.
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
        throw UsageError(where(section.source()) + "unknown section '" + name + "', known are " +
                         known_sections());
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
  std::string known_sections() const {
    std::string text;
    for (const std::string& section : sections_)
      text.append(text.empty() ? "" : ", ").append(section);
    return text;
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
  void read(const toml::node& node, const std::string& key, std::int64_t& value,
            Range range) const {
    value = integer<std::int64_t>(node, key, range);
  }
  void read(const toml::node& node, const std::string& key, std::string& value, Range) const {
    if (!node.is_string()) refuse(node, key, "a text in quotes");
    value = *node.value<std::string>();
  }
  template <typename Enum>
  requires std::is_enum_v<Enum>
  void read(const toml::node& node, const std::string& key, std::vector<Enum>& value,
            Range range) const {
    if (!node.is_array()) refuse(node, key, "a list of texts in quotes");
    value.clear();
    for (const toml::node& element : *node.as_array())
      read(element, key, value.emplace_back(), range);
  }
  template <typename Enum>
  requires std::is_enum_v<Enum>
  void read(const toml::node& node, const std::string& key, Enum& value, Range) const {
    std::string known;
    for (const auto& word : words_of(value)) {
      if (node.is_string() && *node.value<std::string_view>() == word.text) {
        value = word.value;
        return;
      }
      known.append(known.empty() ? "\"" : ", \"").append(word.text).append("\"");
    }
    refuse(node, key, "one of " + known);
  }
  /// Reads a table of names and texts, numbers or truth values. They are kept as the texts that a
  /// camera takes, and in the file's order, because a selector must come before what it selects.
  void read(const toml::node& node, const std::string& key,
            std::vector<std::pair<std::string, std::string>>& value, Range) const {
    constexpr std::size_t kMost = 1000;
    if (!node.is_table() || node.as_table()->size() > kMost)
      refuse(node, key, "a table of at most " + std::to_string(kMost) + " names and values");
    value.clear();
    std::vector<toml::source_position> places;
    for (const auto& [name, element] : *node.as_table()) {
      std::ostringstream text = full_precision();
      if (const auto number = element.value_exact<std::int64_t>())
        text << *number;
      else if (const auto real = element.value_exact<double>())
        text << *real;
      else if (const auto truth = element.value_exact<bool>())
        text << (*truth ? "true" : "false");
      else if (const auto word = element.value_exact<std::string>())
        text << *word;
      else
        refuse(element, key + "." + std::string(name.str()), "a text, a number, true or false");
      const auto place = std::upper_bound(places.begin(), places.end(), name.source().begin);
      value.emplace(value.begin() + (place - places.begin()), name.str(), text.str());
      places.insert(place, name.source().begin);
    }
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

/// Visits every setting, and then holds the text of a file.
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

  template <typename T>
  static std::string value_text(const T& value) {
    TomlWriter writer;
    writer.write(value);
    return writer.text();
  }

 private:
  template <typename Number>
  requires std::is_arithmetic_v<Number>
  void write(Number value) { text_ << value; }
  void write(bool value) { text_ << (value ? "true" : "false"); }
  template <typename Enum>
  requires std::is_enum_v<Enum>
  void write(Enum value) {
    for (const auto& word : words_of(value))
      if (word.value == value) write(std::string(word.text));
  }
  void write(const std::string& value) {
    std::ostringstream quoted;
    quoted << toml::value<std::string>(value);
    text_ << quoted.str();
  }
  void write(const std::vector<std::pair<std::string, std::string>>& values) {
    text_ << "{";
    const char* before = " ";
    for (const auto& [name, value] : values) {
      text_ << std::exchange(before, ", ");
      write(name);
      text_ << " = ";
      write(value);
    }
    text_ << (values.empty() ? "}" : " }");
  }
  template <typename Element>
  void write(const std::vector<Element>& values) {
    text_ << "[";
    for (std::size_t i = 0; i < values.size(); ++i) {
      text_ << (i > 0 ? ", " : "");
      write(values[i]);
    }
    text_ << "]";
  }

  std::ostringstream text_ = full_precision();
  std::string section_;
};

}  // namespace curlew
