#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <memory>

#include "acquisition/fits/partial_path.h"
#include "acquisition/recording/fits_source.h"
#include "core/error.h"
#include "service/air/air_table.h"
#include "service/commands/air_flags.h"
#include "service/commands/commands.h"
#include "service/commands/force_flag.h"
#include "service/commands/night_merge.h"
#include "service/commands/page_flag.h"
#include "service/commands/pipeline_flags.h"
#include "service/commands/shown_frames.h"
#include "service/method_choice.h"
#include "service/picture/frame_picture.h"
#include "service/pipeline.h"
#include "service/program/interrupt.h"
#include "service/program/outputs.h"
#include "service/program/progress.h"
#include "service/results/frame_modes.h"
#include "service/results/json_lines.h"
#include "service/results/latency_report.h"
#include "service/results/results_file.h"
#include "service/results/track_summary.h"
#include "service/results/truth_match.h"
#include "service/results/vortex_printer.h"
#include "service/sensor/contradictions.h"
#include "service/sensor/sensor_file.h"
#include "service/shards/shard_choice.h"
#include "service/shards/shard_worker.h"
#include "service/sweep/sweep.h"
#include "service/thread_placement.h"

namespace curlew {
namespace {

struct ReplayOptions {
  std::vector<std::string> recordings;
  std::string sensor;
  std::string hdu;
  std::string region;
  PipelineFlags pipeline;
  std::string out;
  std::string shard;
  std::string jsonl;
  std::string picture;
  ShownFramesOptions shown;
  std::string sweep;
  std::vector<std::string> save;
  AirOptions air;
  double pace_hz = 0.0;
  std::int64_t show = 3;
  Existing existing = Existing::kRefused;
};

FrameSelection selection_of(const ReplayOptions& options) {
  return {.hdu = options.hdu, .region = parse_region(options.region)};
}

/// Says whether more is to be made of the frames than a results file.
bool has_views(const ReplayOptions& options) {
  return !options.jsonl.empty() || !options.picture.empty() || options.shown.wanted() ||
         options.air.window_s > 0.0;
}

/// As check_usage, for a shard. What is there already is looked at later, because a shard that is
/// done is not done again.
void check_shard_usage(const ReplayOptions& options, const std::vector<std::string>& inputs) {
  if (options.out.empty())
    throw UsageError("--shard needs --out, the results file of all shards together");
  if (has_views(options) || options.pace_hz != 0.0 || !options.sweep.empty())
    throw UsageError(
        "--jsonl, --picture, --page, --report, --air, --pace and --sweep go with one run over all "
        "frames, not --shard");
  check_output(options.out, inputs, Existing::kReplaced);
}

/// Refuses options that contradict each other, before anything is read or written.
void check_usage(const ReplayOptions& options, const FramePictureOptions& picture) {
  std::vector<std::string> inputs = options.recordings;
  inputs.push_back(options.sensor);
  inputs.push_back(options.pipeline.config);
  inputs.push_back(options.sweep);
  if (!options.shard.empty()) return check_shard_usage(options, inputs);
  if (!options.sweep.empty() && (options.out.empty() || has_views(options)))
    throw UsageError(
        "--sweep needs --out, which its results files are named after, and goes without --jsonl, "
        "--picture, --page, --report and --air");
  if (options.sweep.empty()) check_output(options.out, inputs, options.existing);
  check_output(picture.path, inputs, options.existing);
  check_output(options.shown.report, inputs, options.existing);
  check_stream_output(options.jsonl, inputs, options.existing);
  if (!options.save.empty() && options.out.empty())
    throw UsageError("--save goes into --out, name a file there");
  if (!options.out.empty() && !options.jsonl.empty() &&
      target_of(options.out) == target_of(options.jsonl))
    throw UsageError("--out and --jsonl name the same file " + options.out);
  if (options.pace_hz != 0.0 && !(options.pace_hz >= 1e-3 && options.pace_hz <= 1e6))
    throw UsageError("--pace must be from 0.001 to 1000000 Hz, or 0");
}

void print_input(const ReplayOptions& options, const FitsSource& source, const Sensor& sensor) {
  fmt::print("{} frames of {} x {} px, {} of {} x {} lenslets lit\n", source.frame_count(),
             source.format().cols, source.format().rows,
             std::count(sensor.valid.begin(), sensor.valid.end(), std::uint8_t{1}),
             sensor.grid.cols, sensor.grid.rows);
  for (const std::string& note : source.notes()) fmt::print("{}\n", note);
  if (!source.map_report().empty()) fmt::print("{}\n", source.map_report());
  for (const std::string& note :
       contradictions(sensor, source, options.recordings.front(), selection_of(options)))
    fmt::print("{}\n", note);
}

/// The files for the results; null if a file was not asked for.
struct ReplayFiles {
  std::unique_ptr<ResultsFile> results;
  std::unique_ptr<JsonLines> lines;
  std::unique_ptr<Sweep> sweep;            ///< the files of the sweep's other configurations
  std::unique_ptr<FrameModes> line_modes;  ///< null if the lines have no Zernikes

  void commit() const {
    if (results) results->commit();
    if (sweep) sweep->commit();
    if (lines) lines->commit();
  }
};

/// What is printed of the frames.
struct ReplayTables {
  VortexPrinter vortices;
  TrackSummary tracks;
  std::unique_ptr<AirTable> air;  ///< null if it was not asked for

  /// Returns the air of a window that is complete without this frame.
  std::optional<AirReport> add(const FrameSlot& slot) {
    vortices.add(slot);
    tracks.add(slot.frame_index, slot.frame->header, slot.vortices);
    return air ? air->add(slot) : std::nullopt;
  }
  void print() const {
    constexpr std::size_t kMostTracks = 12;
    vortices.summarize();
    if (const std::string text = tracks.text(kMostTracks); !text.empty())
      fmt::print("\n{}\n", text);
    if (air) fmt::print("{}\n", air->text());
  }
};

RunReport run_pipeline(const ReplayOptions& options, const Config& config,
                       const std::shared_ptr<const Plan>& plan, FitsSource& source,
                       ThreadPlacement& placement, const ReplayFiles& files, ReplayTables& tables,
                       const std::function<void(const FrameSlot&)>& draw, FrameStore* shown) {
  FrameResult result(plan->detect.capacity());
  Progress progress("replay", source.frame_count());
  Pipeline pipeline(plan, config.pipeline, placement.thread_start());
  RecordedFeed feed(source, {options.pace_hz, -1});
  Publisher publisher;
  publisher.publish = [&](const FrameSlot& slot) {
    if (files.results) files.results->add(slot);
    draw(slot);
  };
  publisher.finish = [&](FrameSlot& slot, std::int64_t dropped) {
    if (files.results) files.results->add_latency(slot);
    const std::optional<AirReport> air = tables.add(slot);
    if (files.lines) {
      result.copy(slot, dropped);
      if (files.line_modes) files.line_modes->fit(slot, result.zernike);
      files.lines->add(result, air ? &*air : nullptr);
    }
    if (shown != nullptr) shown->add(slot, dropped);
    if (files.sweep) files.sweep->work(slot);
    progress.step();
  };
  return pipeline.run(feed, publisher);
}

void print_summary(const RunReport& report, const Config& config,
                   const ThreadPlacement& placement) {
  fmt::print("{} frames, {}, {} frames dropped, {:.1f} frames/s\n", report.frames,
             found_text(report), report.dropped,
             static_cast<double>(report.frames) / report.seconds);
  if (const std::string text = followed_text(report); !text.empty()) fmt::print("{}\n", text);
  for (const std::string& text : doubts(report)) fmt::print("{}\n", text);
  if (report.overflow > 0)
    fmt::print("{} more vortices did not fit: raise [pipeline] max_vortices\n", report.overflow);
  if (report.not_converged > 0)
    fmt::print("{} frames whose split did not converge: raise [split] max_iterations\n",
               report.not_converged);
  if (!config.pipeline.cpus.empty()) fmt::print("threads pinned to: {}\n", placement.description());
  fmt::print("\n{}", latency_table(report));
}

/// Does a shard of the night or all of them. Who merges does, after the others, those shards that
/// did not begin where the one before ended.
void replay_shard(const ReplayOptions& options, const std::shared_ptr<const Plan>& plan,
                  std::int64_t frames) {
  // getenv() is safe among threads here, because nothing in the program sets a variable.
  const ShardChoice choice = choose_shard(options.shard, [](const char* name) -> const char* {
    return std::getenv(name);  // NOLINT(concurrency-mt-unsafe)
  });
  if (choice.merges) check_output(options.out, {}, options.existing);
  ThreadPlacement placement(plan->config.pipeline.cpus, plan->config.realtime.priority);
  const ShardWorker worker({.recordings = options.recordings,
                            .selection = selection_of(options),
                            .plan = plan,
                            .saved = options.save,
                            .frames = frames,
                            .shards = choice.shards,
                            .out = options.out,
                            .existing = options.existing},
                           placement);
  if (choice.shard > 0) worker.do_shard(choice.shard);
  if (!choice.merges) return;
  worker.do_all_shards(choice.shard > 0 ? ShardWorker::Others::kAtWork
                                        : ShardWorker::Others::kNone);
  merge_night(worker.paths(), options.out, options.existing);
}

/// Returns the configurations that are asked for: one without a name, or those of a sweep.
std::vector<NamedConfig> configurations(const ReplayOptions& options, bool hidden_phase) {
  std::vector<NamedConfig> configs{{{}, options.pipeline.configuration()}};
  if (!options.sweep.empty()) {
    configs = read_sweep(options.sweep, configs.front().config);
    std::vector<std::string> inputs = options.recordings;
    inputs.insert(inputs.end(), {options.sensor, options.pipeline.config, options.sweep});
    for (const NamedConfig& named : configs) {
      check_output(sweep_output(options.out, named.name), inputs, options.existing);
      refuse_settings_without_effect(named.config);
    }
  }
  for (NamedConfig& named : configs) named.config.split.hidden_phase |= hidden_phase;
  return configs;
}

void replay(const ReplayOptions& options) {
  const FramePictureOptions picture = frame_picture_options(options.picture);
  check_usage(options, picture);
  const SaveOptions save = save_options_from(options.save);
  const std::vector<NamedConfig> configs =
      configurations(options, save.whole_phase || options.shown.wanted());
  const Config& config = configs.front().config;
  Sensor sensor = read_sensor(options.sensor);
  FitsSource source(options.recordings, selection_of(options));
  add_bad_pixels(sensor, source.nan_pixels());
  const auto plan = std::make_shared<const Plan>(sensor, source.format(), config);
  if (!options.shard.empty()) return replay_shard(options, plan, source.frame_count());
  const Truth truth(options.recordings, selection_of(options));
  ReplayFiles files;
  // This comes before anything is printed, because the lines may take standard output.
  if (!options.jsonl.empty()) files.lines = std::make_unique<JsonLines>(options.jsonl);
  if (config.daemon.lines.zernike) files.line_modes = std::make_unique<FrameModes>(*plan);
  if (const std::string line = method_line(plan->detect.choice()); !line.empty())
    fmt::print("{}\n", line);
  print_input(options, source, sensor);
  if (!options.sweep.empty()) {
    files.results = std::make_unique<ResultsFile>(sweep_output(options.out, configs.front().name),
                                                  *plan, save, source.frame_count());
    files.sweep = std::make_unique<Sweep>(configs, *plan, sensor, source.format(), save,
                                          options.out, source.frame_count());
  } else if (!options.out.empty()) {
    files.results = std::make_unique<ResultsFile>(options.out, *plan, save, source.frame_count());
  }
  ReplayTables tables{VortexPrinter(truth, *plan, options.show), {}, {}};
  if (options.air.window_s > 0.0) tables.air = std::make_unique<AirTable>(*plan, options.air);
  ThreadPlacement placement(config.pipeline.cpus, config.realtime.priority);
  bool drawn = false;
  const auto draw = [&](const FrameSlot& slot) {
    if (slot.frame_index != picture.frame) return;
    write_frame_picture(picture.path, sensor, slot);
    drawn = true;
  };
  const ShownFrames shown(options.shown, options.recordings.front(), plan);
  const RunReport report =
      run_pipeline(options, config, plan, source, placement, files, tables, draw, shown.store());
  if (files.results && tables.air) files.results->append(tables.air->table());
  files.commit();
  tables.print();
  print_summary(report, config, placement);
  if (interrupted())
    throw Failure(fmt::format("interrupted: the files hold the first {} of {} frames",
                              report.frames, source.frame_count()));
  if (drawn) fmt::print("\n{}\n", frame_picture_legend(picture));
  if (!drawn && picture.frame >= 0)
    throw Failure(
        fmt::format("--picture: there is no frame {}, only {}", picture.frame, report.frames));
  shown.finish();
  if (files.sweep) {
    fmt::print("\n{}", files.sweep->text());
    if (const std::string name = files.sweep->without_measurement(); !name.empty())
      throw Failure("nothing was measured in any frame by the configuration " + name);
  }
  if (const std::string why = nothing_measured(report); !why.empty()) throw Failure(why);
  shown.wait();
}

}  // namespace

void add_replay(CLI::App& app) {
  auto options = std::make_shared<ReplayOptions>();
  CLI::App* command = app.add_subcommand("replay", "Run the pipeline over recordings");
  command
      ->add_option(
          "recordings", options->recordings,
          "FITS, PNG, TIFF or npy files in order, directories of pictures, or patterns in quotes")
      ->required();
  command->add_option("--sensor", options->sensor, "sensor file made by 'curlew calibrate'")
      ->required();
  command->add_option("--hdu", options->hdu,
                      "image to read, by EXTNAME or number (0: the primary)");
  command->add_option("--region", options->region,
                      "part of each frame to read: X,Y,W,H in px from 0 (default: key DATASEC)");
  command->add_option("--out", options->out, "results file to write (FITS)");
  command
      ->add_option(
          "--save", options->save,
          "images to put into --out, with commas between them: slopes, flux, phase, whole_phase, "
          "solenoidal, circulation, zernike, frame")
      ->delimiter(',');
  command->add_option("--jsonl", options->jsonl,
                      "file to write with one JSON object a frame; - for standard output");
  command->add_option("--picture", options->picture,
                      "FRAME:FILE.png: PNG to draw a frame into, with its slopes and vortices");
  add_page_flag(*command, options->shown.page);
  command->add_option(
      "--report", options->shown.report,
      "HTML file to write: the page with its frames, which opens without a network");
  command->add_option("--shard", options->shard,
                      "do one part of the frames: I/N, auto (by mpirun or a Slurm array), or all/N "
                      "(each, and merge)");
  command->add_option("--sweep", options->sweep,
                      "TOML file with several configurations, each a table: frames are read once, "
                      "and each configuration NAME gets a results file, --out with .NAME");
  command
      ->add_option_function<std::string>(
          "--progress",
          [](const std::string& style) {
            Progress::set_style(style == "json" ? ProgressStyle::kJson : ProgressStyle::kTerminal);
          },
          "how progress is shown: terminal (default, nothing where there is none), or json, a line "
          "a second on standard error")
      ->check(CLI::IsMember({"terminal", "json"}));
  add_force_flag(*command, options->existing);
  options->pipeline.add_to(*command);
  add_air_flags(*command, options->air);
  command->add_option("--pace", options->pace_hz,
                      "greatest rate at which frames are delivered, Hz");
  command->add_option("--show", options->show, "how many frames' vortices are printed (default 3)");
  command->callback([options] { replay(*options); });
}

}  // namespace curlew
