#include "acquisition/aravis/genicam_description.h"

#include <glib.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <vector>

#include "core/error.h"
#include "core/printable.h"

namespace curlew {
namespace {

// A feature that leads to its value over more others than this is taken for an attack.
constexpr std::size_t kDeepest = 10'000;
constexpr std::int64_t kLongestRegister_bytes = 65536;

/// Elements whose text names the feature that a value is computed from. Others, as pMax, refer to
/// each other in circles in good descriptions too.
constexpr std::array<std::string_view, 8> kValueReferences{
    "pValue", "pVariable", "pAddress",      "pLength",
    "pIndex", "pOffset",   "pValueDefault", "pValueIndexed"};

/// What the description says, as far as it is of interest.
struct Description {
  std::map<std::string, std::set<std::string>> needs;  ///< by name: those its value is made of
  std::vector<std::string> elements;                   ///< those that are open, outermost first
  std::vector<std::string> features;  ///< of each open element, the feature that it belongs to
  std::string text;                   ///< of the innermost
  std::string trouble;                ///< the first contradiction
};

void start(GMarkupParseContext*, const char* element, const char** names, const char** values,
           void* data, GError**) {
  auto& description = *static_cast<Description*>(data);
  std::string feature = description.features.empty() ? "" : description.features.back();
  // References have names as well, by which formulas call them.
  if (element[0] != 'p')
    for (std::size_t i = 0; names[i] != nullptr; ++i)
      if (std::string_view(names[i]) == "Name") {
        // The parts of a register lie where it lies.
        if (std::string_view(element) == "StructEntry")
          description.needs[values[i]].insert(feature);
        feature = values[i];
      }
  description.elements.emplace_back(element);
  description.features.push_back(std::move(feature));
  description.text.clear();
}

void check_length(Description& description, const std::string& parent) {
  std::int64_t bytes = 0;
  const std::string& text = description.text;
  std::from_chars(text.data(), text.data() + text.size(), bytes);
  // Only registers without a type may be large, as tables are.
  const bool is_good = bytes > 0 && (bytes <= kLongestRegister_bytes || parent == "Register");
  if (!is_good && text.rfind("0x", 0) != 0 && description.trouble.empty())
    description.trouble = description.features.back() + " has a length of " + text + " bytes";
}

void end(GMarkupParseContext*, const char* element, void* data, GError**) {
  auto& description = *static_cast<Description*>(data);
  std::string& text = description.text;
  text.erase(0, std::min(text.find_first_not_of(" \t\r\n"), text.size()));
  text.erase(text.find_last_not_of(" \t\r\n") + 1);
  if (std::find(kValueReferences.begin(), kValueReferences.end(), element) !=
      kValueReferences.end())
    description.needs[description.features.back()].insert(text);
  if (std::string_view(element) == "Length" && description.elements.size() > 1)
    check_length(description, description.elements[description.elements.size() - 2]);
  description.elements.pop_back();
  description.features.pop_back();
  text.clear();
}

void text(GMarkupParseContext*, const char* characters, gsize size, void* data, GError**) {
  static_cast<Description*>(data)->text.append(characters, size);
}

/// Returns the first feature found whose value needs itself; empty if there is none.
std::string find_circle(const std::map<std::string, std::set<std::string>>& needs) {
  enum class State { kUnseen, kOpen, kDone };
  std::map<std::string, State> states;
  struct Step {
    const std::string* feature;
    std::set<std::string>::const_iterator next;
  };
  for (const auto& [first, unused] : needs) {
    std::vector<Step> path;
    const auto enter = [&](const std::string& feature) {
      const auto found = needs.find(feature);
      if (found == needs.end()) return;
      states[feature] = State::kOpen;
      path.push_back({&found->first, found->second.begin()});
    };
    if (states[first] == State::kUnseen) enter(first);
    while (!path.empty()) {
      Step& step = path.back();
      if (step.next == needs.at(*step.feature).end()) {
        states[*step.feature] = State::kDone;
        path.pop_back();
        continue;
      }
      const std::string& needed = *step.next++;
      if (states[needed] == State::kOpen || path.size() > kDeepest) return needed;
      if (states[needed] == State::kUnseen) enter(needed);
    }
  }
  return {};
}

}  // namespace

void check_genicam_description(std::string_view xml, const std::string& camera) {
  const auto refuse = [&](const std::string& why) {
    throw Failure(printable("the description (GenICam XML) of the camera " + camera +
                            " cannot be used: " + why +
                            "; is it damaged, or its firmware at fault?"));
  };
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (xml.rfind(kByteOrderMark, 0) == 0) xml.remove_prefix(kByteOrderMark.size());
  // Only names are of interest, and these are ASCII, whatever the encoding of the rest.
  std::string ascii(xml);
  std::replace_if(
      ascii.begin(), ascii.end(),
      [](char c) { return (static_cast<unsigned char>(c) & 0x80U) != 0; }, '?');
  Description description;
  constexpr GMarkupParser kParser{start, end, text, nullptr, nullptr};
  const std::unique_ptr<GMarkupParseContext, decltype(&g_markup_parse_context_free)> context(
      g_markup_parse_context_new(&kParser, G_MARKUP_TREAT_CDATA_AS_TEXT, &description, nullptr),
      &g_markup_parse_context_free);
  GError* error = nullptr;
  if (g_markup_parse_context_parse(context.get(), ascii.data(), static_cast<gssize>(ascii.size()),
                                   &error) == FALSE ||
      g_markup_parse_context_end_parse(context.get(), &error) == FALSE) {
    const std::string what = error != nullptr ? error->message : "it is no XML";
    g_clear_error(&error);
    refuse("it is cut off or damaged (" + what + ")");
  }
  if (!description.trouble.empty()) refuse(description.trouble);
  if (const std::string circle = find_circle(description.needs); !circle.empty())
    refuse("the value of " + circle + " refers to itself, or to very many others");
}

}  // namespace curlew
