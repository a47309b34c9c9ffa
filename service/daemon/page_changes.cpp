#include "service/daemon/page_changes.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "core/error.h"

namespace curlew {
namespace {

using Json = nlohmann::json;

SettingValue value_of(const Json& json) {
  if (json.is_boolean()) return json.get<bool>();
  if (json.is_number_integer()) return json.get<std::int64_t>();
  if (json.is_number()) return json.get<double>();
  if (json.is_string()) return json.get<std::string>();
  throw UsageError("the value must be a text, a number, true or false");
}

void set(DaemonPipeline& pipeline, DaemonConnection& connection, const std::string& name,
         const Json& value) {
  if (std::ranges::find(kPageSettings, name) == kPageSettings.end())
    throw UsageError("the page may not change '" + name + "'");
  const std::size_t dot = name.find('.');
  const std::string section = name.substr(0, dot);
  pipeline.change(section, name.substr(dot + 1), value_of(value));
  if (section == "camera") connection.reconnect();
}

void act(const PageTargets& targets, const std::string& what, const Json& json,
         const std::string& peer) {
  DaemonPipeline& pipeline = targets.pipeline;
  if (what == "expose") {
    targets.connection.expose();
  } else if (what == "trigger") {
    if (!pipeline.trigger())
      throw UsageError("set mode = \"trigger\" in section [recorder] to record on a trigger");
  } else if (what == "record" || what == "pause_recording") {
    if (!pipeline.pause_recording(what == "pause_recording"))
      throw UsageError("nothing is recorded: set mode in section [recorder]");
  } else if (what == "take_dark" || what == "take_reference") {
    const Json frames = json.value("frames", Json(100));
    if (!frames.is_number_integer()) throw UsageError("frames must be a whole number");
    targets.calibration.begin(
        what == "take_dark" ? LiveCalibration::Kind::kDark : LiveCalibration::Kind::kReference,
        frames.get<std::int64_t>(), peer);
  } else {
    throw UsageError(
        "trigger, expose, record, pause_recording, take_dark and take_reference are known, not '" +
        what + "'");
  }
}

}  // namespace

std::string change_by_page(const PageTargets& targets, const std::string& body,
                           const std::string& peer) {
  std::string why;
  const Json json = Json::parse(body, nullptr, false);
  try {
    if (!json.is_object()) throw UsageError("this is no JSON object");
    if (const std::string what = json.value("do", ""); !what.empty())
      act(targets, what, json, peer);
    else
      set(targets.pipeline, targets.connection, json.value("set", ""), json.value("value", Json()));
  } catch (const std::exception& error) {
    why = error.what();
  }
  // What a stranger sends stands on one line of the log, in plain signs.
  const std::string asked =
      json.is_discarded() ? "no JSON" : json.dump(-1, ' ', true, Json::error_handler_t::replace);
  if (why.empty())
    spdlog::info("page: {} asked for {}", peer, asked);
  else
    spdlog::warn("page: {} asked for {} in vain: {}", peer, asked, why);
  return why;
}

}  // namespace curlew
