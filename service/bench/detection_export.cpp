#include "service/bench/detection_export.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <system_error>

#include "acquisition/fits/fits_file.h"
#include "acquisition/recording/recording.h"
#include "acquisition/simulator/simulator.h"
#include "core/error.h"
#include "service/bench/benchmark_fields.h"
#include "service/bench/detection_rows.h"
#include "service/program/version.h"

namespace curlew {
namespace {

constexpr int kReferenceFrames = 20;

void write_text(const std::filesystem::path& path, const std::string& text) {
  std::ofstream file(path);
  file << text;
  if (!file.flush()) throw Failure(fmt::format("{} cannot be written", path.string()));
}

void make_folder(const std::filesystem::path& folder) {
  std::error_code error;
  if (!std::filesystem::create_directories(folder, error) || error) {
    throw Failure(fmt::format("the folder {} cannot be made: {}; name one that does not exist yet",
                              folder.string(), error ? error.message() : "it exists"));
  }
}

RecordingWriter recording(const std::filesystem::path& path, const MeasurementPlan& plan) {
  // A pitch is as many pixels as a window has, and the spots are as wide as in the plan.
  Optics optics = plan.sensor().optics;
  optics.pixel_m = optics.pitch_m / plan.parameters().window_px;
  optics.wavelength_m =
      optics.pitch_m * optics.pixel_m * plan.parameters().samples_per_lambda_w / optics.focal_m;
  return {path.string(), plan.format(), optics, plan.sensor().detector, Provenance(kProgram)};
}

/// Writes frames of light that does not change, with the cell's noise.
void write_still_frames(const std::filesystem::path& path, const MeasurementPlan& plan,
                        const Realisation& realisation, std::uint64_t first_seed) {
  RecordingWriter writer = recording(path, plan);
  MeasuredFrame frame(plan);
  for (std::uint64_t i = 0; i < kReferenceFrames; ++i) {
    measure_frame(plan, realisation, first_seed + i, frame);
    writer.append(frame.frame.view(), frame.frame.header);
  }
  writer.commit();
}

/// Writes what a cell needs beside its frames. Without noise the light itself is written.
void write_reference(const std::filesystem::path& stem, const FieldParameters& field,
                     MeasurementOptions measurement) {
  constexpr std::uint64_t kReferenceSeed = 9'000'000;  // no subset has it
  SimulatorOptions plane = simulator_options(field, kReferenceSeed);
  plane.turbulence.reset();
  Simulator simulator(plane);
  Realisation reference{simulator.expected_image_e(0), {}};
  if (!std::isfinite(measurement.photons)) {
    FitsFile file = FitsFile::create(stem.string() + "_reference.fits");
    file.create_image(ElementType::kF32, {reference.light.rows(), reference.light.cols()});
    file.write_pixels<float>(0, {reference.light.data(), reference.light.size()});
    file.commit();
    return;
  }
  measurement.faded = 0.0;
  const MeasurementPlan plan(field, measurement);
  write_still_frames(stem.string() + "_reference.fits", plan, reference, kReferenceSeed);
  reference.light.fill(0.0F);
  const MeasurementPlan dark(field, measurement);
  write_still_frames(stem.string() + "_dark.fits", dark, reference,
                     kReferenceSeed + kReferenceFrames);
}

/// The frames of one subset of a cell, as one file: a recording, or without noise the light.
class FrameFile {
 public:
  FrameFile(const std::filesystem::path& path, const MeasurementPlan& plan, std::size_t frames) {
    if (plan.noisy()) {
      recording_.emplace(recording(path, plan));
      return;
    }
    light_.emplace(FitsFile::create(path.string()));
    light_->create_image(ElementType::kF32, {static_cast<std::int64_t>(frames), plan.format().rows,
                                             plan.format().cols});
  }
  void append(const MeasuredFrame& frame, const Realisation& realisation) {
    if (recording_) {
      recording_->append(frame.frame.view(), frame.frame.header);
      return;
    }
    const Image<float>& light = realisation.light;
    light_->write_pixels<float>(written_, {light.data(), light.size()});
    written_ += static_cast<std::int64_t>(light.size());
  }
  void commit() {
    if (recording_) recording_->commit();
    if (light_) light_->commit();
  }

 private:
  std::optional<RecordingWriter> recording_;
  std::optional<FitsFile> light_;
  std::int64_t written_ = 0;
};

std::string truth_text(const BenchmarkFields& fields, const Interior& interior) {
  std::string text = "frame,x,y,charge,required,interior\n";
  for (std::size_t i = 0; i < fields.truths.size(); ++i) {
    for (const GradedVortex& v : fields.truths[i])
      text += fmt::format("{},{:.5f},{:.5f},{},{},{}\n", i, v.x, v.y, v.charge, v.required ? 1 : 0,
                          interior.contains(v.x, v.y) ? 1 : 0);
  }
  return text;
}

void export_subset(const std::filesystem::path& folder, const std::string& cell,
                   const MeasurementPlan& plan, const BenchmarkFields& fields) {
  const std::string name = cell + (fields.subset == Subset::kTest ? "_test" : "_validation");
  const Interior interior{plan.parameters().rows, plan.parameters().cols, &plan.sensor().valid};
  write_text(folder / (name + "_truth.csv"), truth_text(fields, interior));
  std::vector<DetectorRow> rows = make_detector_rows(plan);
  std::erase_if(rows, [](const DetectorRow& row) {
    return row.name != "whitened" && row.name != "classifier";
  });
  std::vector<std::string> entries(rows.size(), "frame,x,y,charge,score\n");
  FrameFile file(folder / (name + ".fits"), plan, fields.realisations.size());
  MeasuredFrame frame(plan);
  for (std::size_t i = 0; i < fields.realisations.size(); ++i) {
    measure_frame(plan, fields.realisations[i],
                  realisation_seed(fields.subset, static_cast<int>(i)), frame);
    file.append(frame, fields.realisations[i]);
    for (std::size_t row = 0; row < rows.size(); ++row) {
      for (const Candidate& c : rows[row].find(frame))
        entries[row] += fmt::format("{},{:.5f},{:.5f},{},{:.9g}\n", i, c.x, c.y, c.charge, c.score);
    }
  }
  file.commit();
  for (std::size_t row = 0; row < rows.size(); ++row)
    write_text(folder / rows[row].name / (name + ".csv"), entries[row]);
}

}  // namespace

void export_detection_benchmark(const DetectionBenchmarkOptions& options,
                                const RealisationCache& cache, const std::string& folder,
                                const std::function<void()>& step) {
  if (options.measurement.pupil != PupilShape::kSquare)
    throw UsageError("--export knows the square pupil alone; leave --pupil out");
  const std::filesystem::path root(folder);
  make_folder(root);
  make_folder(root / "whitened");
  make_folder(root / "classifier");
  write_text(root / "README.md", kExportedReadme);
  write_text(root / "score.py", kExportedScorer);
  std::string cells = "cell,rytov_variance,photons,rows,cols,window_px,validation,test\n";
  for_each_cell(options, cache, step,
                [&](const MeasurementPlan& plan, const BenchmarkFields& validation,
                    const BenchmarkFields& test) {
                  const FieldParameters& field = plan.parameters();
                  const double photons = plan.options().photons;
                  const double stated = std::isfinite(photons) ? photons : 0.0;
                  const std::string cell =
                      fmt::format("rytov{}_photons{}", field.rytov_variance, stated);
                  write_reference(root / cell, field, plan.options());
                  export_subset(root, cell, plan, validation);
                  export_subset(root, cell, plan, test);
                  cells += fmt::format("{},{},{},{},{},{},{},{}\n", cell, field.rytov_variance,
                                       stated, field.rows, field.cols, field.window_px,
                                       options.validation_realisations, options.test_realisations);
                });
  write_text(root / "cells.csv", cells);
}

}  // namespace curlew
