// The training of the classifier's scout and screen: they learn what the trained network finds.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "detect/classifier/classifier_network.h"
#include "service/training/training_fields.h"

namespace curlew {

/// Trains the scout's layers of a network whose other layers are trained. Logs what thresholds
/// would cost.
void train_scout(const std::vector<TrainingField>& fields, std::uint64_t seed,
                 ClassifierNetwork& network, const std::function<void(const std::string&)>& log);

/// Trains the screen in the same way, after the scout, on the nodes that the scout lets pass.
void train_screen(const std::vector<TrainingField>& fields, std::uint64_t seed,
                  ClassifierNetwork& network, const std::function<void(const std::string&)>& log);

}  // namespace curlew
