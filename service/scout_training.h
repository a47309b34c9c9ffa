// The training of the classifier's scout: it learns what the trained network finds.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "detect/classifier_network.h"
#include "service/training_fields.h"

namespace curlew {

/// Trains the scout's layers of a network whose other layers are trained. Logs what thresholds
/// would cost.
void train_scout(std::vector<TrainingField>& fields, std::uint64_t seed, ClassifierNetwork& network,
                 const std::function<void(const std::string&)>& log);

}  // namespace curlew
