#include "service/results/json_line.h"

#include <nlohmann/json.hpp>

#include "service/air/air_json.h"
#include "service/results/json_float.h"

namespace curlew {
namespace {

nlohmann::json microseconds(std::int64_t ns) { return static_cast<double>(ns) / 1000.0; }

}  // namespace

void append_json_line(const FrameResult& result, std::string& text, const AirReport* air) {
  const FrameHeader& header = result.header;
  nlohmann::ordered_json line;
  line["frame"] = result.frame_index;
  line["sequence"] = header.sequence;
  line["camera_ns"] = header.camera_ns;
  line["received_ns"] = header.received_ns;
  line["dropped"] = result.dropped;
  line["status"] = header.status;
  line["n_valid"] = result.n_valid;
  line["n_lost"] = result.n_lost;
  line["n_islands"] = result.n_islands;
  auto& vortices = line["vortices"] = nlohmann::ordered_json::array();
  for (const Vortex& v : result.vortices) {
    const auto pixel =
        result.grid.pixel_from_lenslet(static_cast<double>(v.x), static_cast<double>(v.y));
    vortices.push_back({{"x", json_float(v.x)},
                        {"y", json_float(v.y)},
                        {"charge", v.charge},
                        {"circulation", json_float(v.circulation)},
                        {"significance", json_float(v.significance)},
                        {"x_px", pixel[0]},
                        {"y_px", pixel[1]},
                        {"flags", v.flags},
                        {"track", v.track},
                        {"probability", v.probability < 0.0F ? nlohmann::json(nullptr)
                                                             : json_float(v.probability)},
                        {"vx", json_float(v.velocity_x)},
                        {"vy", json_float(v.velocity_y)}});
  }
  auto& latency = line["latency_us"] = nlohmann::ordered_json::object();
  for (std::size_t stage = 0; stage < kStageCount; ++stage)
    latency[kStages[stage].name] = microseconds(result.latency.stage_ns[stage]);
  latency["publish"] = microseconds(result.latency.publish_ns);
  latency["total"] = microseconds(result.latency.total_ns);
  if (!result.zernike.empty()) {
    auto& zernike = line["zernike"] = nlohmann::ordered_json::array();
    for (const float coefficient : result.zernike) zernike.emplace_back(json_float(coefficient));
  }
  if (air != nullptr) line["air"] = air_json(*air);
  text += line.dump();
  text += '\n';
}

}  // namespace curlew
