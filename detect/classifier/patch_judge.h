// This file declares a judge: an encoder of spots, and a head that looks at the codes of 4×4 of
// them, both for one sensor.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "core/centroids.h"
#include "core/frame.h"
#include "core/image.h"
#include "detect/classifier/classifier_network.h"
#include "detect/classifier/frame_blur.h"
#include "detect/classifier/patch_layer.h"
#include "detect/classifier/spot_features.h"

namespace curlew {

/// Holds what the layers of a judge become for one sensor. It is const after construction.
struct PatchJudge {
  /// like_training: see ClassifierOptions::as_trained.
  PatchJudge(const ClassifierNetwork& network, const JudgeLayers& of_network,
             const SpotCamera& camera, bool like_training);

  JudgeLayers layers;
  bool as_trained;
  SpotCodings codings;  ///< what the encoder is told of the sensor, by the blur of a frame's spots
  PatchLayer head;      ///< the first layer of the head in fixed point
  /// These are the code of a missing lenslet, [layers.code].
  AlignedVector<float> missing_code;
  AlignedVector<std::int16_t> missing_rounded;
};

/// Holds the codes of one frame's spots for one judge. The maps are one lenslet wider all round.
struct SpotCodes {
  SpotCodes(const PatchJudge& judge, int rows, int cols);

  /// What the encoder is told in this frame. Null where the spots are wider than it was taught.
  const SpotCoding* coding = nullptr;
  Image<std::int16_t> rounded;  ///< [rows + 2, (cols + 2)·layers.code], in 1/kCodeSteps
  Image<float> exact;           ///< the same as floats, where judge.as_trained
};

/// These are the spots of one frame.
struct FrameSpots {
  const SpotFeatures& features;
  FrameView frame;
  const FrameShift& shift;
  const Centroids& centroids;
  float mean_flux_adu;
};

/// Keeps the features of the spots that were encoded in a frame, so that another judge need not
/// measure them again.
struct MeasuredSpots {
  explicit MeasuredSpots(std::size_t lenslets);

  /// [lenslets, kSpotFeatures] in the order of measuring, and room for kProjectionSlack more.
  AlignedVector<float> features;
  std::size_t count = 0;               ///< number of spots that were measured
  AlignedVector<std::int32_t> places;  ///< [lenslets] where each stands among these
};

/// Numbers between layers, [kJudgeChunk, ClassifierNetwork::kMostInputs].
struct LayerBuffers {
  LayerBuffers();

  AlignedVector<float> a;
  AlignedVector<float> b;
};

inline constexpr int kJudgeChunk = 48;  ///< lenslets or nodes that go through a layer together

/// Measures lenslets, which are row·cols + col and were not measured in this frame, and encodes
/// them. Missing ones get the code of a missing lenslet.
void measure_and_encode(const ClassifierNetwork& network, const PatchJudge& judge,
                        const FrameSpots& spots, std::span<const std::int32_t> lenslets,
                        MeasuredSpots& measured, LayerBuffers& buffers, SpotCodes& codes) noexcept;

/// Encodes lenslets that were measured in this frame.
void encode_measured(const ClassifierNetwork& network, const PatchJudge& judge,
                     const FrameSpots& spots, std::span<const std::int32_t> lenslets,
                     const MeasuredSpots& measured, LayerBuffers& buffers,
                     SpotCodes& codes) noexcept;

/// Finds where the patches of nodes, which are row·(cols − 1) + col, begin in a map of codes with
/// rows of row_step numbers. The map begins one lenslet before the array, as a patch does before
/// its node.
void find_patches(std::span<const std::int32_t> nodes, int node_cols, int code, int row_step,
                  std::int32_t* starts) noexcept;

/// Returns the head's answers for up to kJudgeChunk nodes, [nodes, two NodeOutput and a
/// PairOutput].
const float* judge_patches(const ClassifierNetwork& network, const PatchJudge& judge,
                           const SpotCodes& codes, std::span<const std::int32_t> nodes,
                           int node_cols, LayerBuffers& buffers) noexcept;

}  // namespace curlew
