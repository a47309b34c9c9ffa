#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <charconv>
#include <memory>

#include "acquisition/recording/fits_source.h"
#include "acquisition/recording/milk_recording.h"
#include "acquisition/recording/raw_source.h"
#include "acquisition/recording/recording.h"
#include "core/error.h"
#include "service/commands/commands.h"
#include "service/commands/force_flag.h"
#include "service/program/interrupt.h"
#include "service/program/outputs.h"
#include "service/program/progress.h"
#include "service/program/version.h"

namespace curlew {
namespace {

struct ConvertOptions {
  std::vector<std::string> inputs;
  std::string hdu;
  std::string region;
  std::string raw;  ///< ROWSxCOLS
  std::string raw_type = "u16";
  std::int64_t raw_header = 0;
  std::string out;
  std::string milk;
  std::string name = "curlew";
  Existing existing = Existing::kRefused;
};

/// Reads ROWSxCOLS.
void read_shape(const std::string& text, RawLayout& layout) {
  const char* end = text.data() + text.size();
  const auto rows = std::from_chars(text.data(), end, layout.rows);
  if (rows.ec == std::errc{} && rows.ptr != end && *rows.ptr == 'x') {
    const auto cols = std::from_chars(rows.ptr + 1, end, layout.cols);
    if (cols.ec == std::errc{} && cols.ptr == end) return;
  }
  throw UsageError("--raw must be ROWSxCOLS, as 128x128, not '" + text + "'");
}

RawLayout raw_layout(const ConvertOptions& options) {
  RawLayout layout;
  read_shape(options.raw, layout);
  layout.header_bytes = options.raw_header;
  if (options.raw_type == "u8") {
    layout.pixel = RawPixel::kU8;
  } else if (options.raw_type == "u16be") {
    layout.pixel = RawPixel::kU16BigEndian;
  } else if (options.raw_type != "u16") {
    throw UsageError("--raw-type must be u8, u16 or u16be, not '" + options.raw_type + "'");
  }
  return layout;
}

/// The frames, and what is known of the optics behind them.
struct Input {
  std::unique_ptr<FrameSource> frames;
  Optics optics;
  Detector detector;
};

Input open_input(const ConvertOptions& options) {
  std::vector<std::string> files;
  for (const std::string& input : options.inputs) {
    if (options.raw.empty())
      for (const std::string& file : fits_files_of(input)) files.push_back(file);
    else
      files.push_back(input);
  }
  check_output(options.out, files, options.existing);
  if (!options.raw.empty())
    return {std::make_unique<RawSource>(files, raw_layout(options)), {}, {}};
  const FrameSelection selection{.hdu = options.hdu, .region = parse_region(options.region)};
  auto source = std::make_unique<FitsSource>(files, selection);
  for (const std::string& note : source->notes()) fmt::print("{}\n", note);
  const Optics optics = source->optics();
  const Detector detector = source->detector();
  return {std::move(source), optics, detector};
}

std::int64_t write_recording(const std::string& path, const Input& input) {
  RecordingWriter writer(path, input.frames->format(), input.optics, input.detector, kProgram);
  FrameBuffer frame(input.frames->format());
  Progress progress("convert", input.frames->frame_count());
  while (!interrupted() && input.frames->next(frame) == Delivery::kFrame) {
    writer.append(frame.view(), frame.header);
    progress.step();
  }
  if (interrupted()) throw Failure("interrupted: " + path + " was not written");
  writer.commit();
  return writer.frames();
}

void convert(const ConvertOptions& options) {
  if (options.out.empty() == options.milk.empty())
    throw UsageError("give --out REC.fits or --milk DIR, one of the two");
  if (options.name.empty() || options.name.find('/') != std::string::npos)
    throw UsageError("--name '" + options.name + "' cannot be a stream's name; leave out the '/'");
  const Input input = open_input(options);
  if (options.milk.empty()) {
    const std::int64_t frames = write_recording(options.out, input);
    fmt::print("{}: {} frames of {} x {} px\n", options.out, frames, input.frames->format().cols,
               input.frames->format().rows);
  } else {
    fmt::print("{}\n", write_milk_recording(options.milk, options.name, *input.frames));
  }
}

}  // namespace

void add_convert(CLI::App& app) {
  auto options = std::make_shared<ConvertOptions>();
  CLI::App* command =
      app.add_subcommand("convert", "Turn recordings of other programs into Curlew's, and back");
  command
      ->add_option("inputs", options->inputs,
                   "FITS files, or folders of them, in order; milk's times beside them are kept")
      ->required();
  command->add_option("--out", options->out, "recording to write (FITS)");
  add_force_flag(*command, options->existing);
  command->add_option("--milk", options->milk,
                      "folder to write to as milk does: DIR/YYYYMMDD/NAME/NAME_TIME.fits and .txt");
  command->add_option("--name", options->name, "name of the stream for --milk")
      ->capture_default_str();
  command->add_option("--hdu", options->hdu,
                      "image to read, by EXTNAME or number (0: the primary)");
  command->add_option("--region", options->region,
                      "part of each frame to read: X,Y,W,H in px from 0 (default: key DATASEC)");
  command->add_option("--raw", options->raw,
                      "inputs are nothing but pixels, in frames of this shape: ROWSxCOLS");
  command
      ->add_option("--raw-type", options->raw_type,
                   "pixels of --raw: u8, u16 (little endian) or u16be (big endian)")
      ->capture_default_str();
  command->add_option("--raw-header", options->raw_header, "bytes before the first frame of --raw")
      ->capture_default_str();
  command->callback([options] { convert(*options); });
}

}  // namespace curlew
