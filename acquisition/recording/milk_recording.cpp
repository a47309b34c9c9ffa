#include "acquisition/recording/milk_recording.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string_view>
#include <system_error>

#include "acquisition/fits/fits_file.h"
#include "core/error.h"
#include "core/frame.h"
#include "core/stop_request.h"

namespace curlew {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kNsPerS = 1'000'000'000;
constexpr std::int64_t kNsPerDay = 86400 * kNsPerS;
constexpr std::size_t kColumns = 7;

/// Reads "1800000000.123456789" to the nanosecond, which a double could not hold. nullopt: no
/// number.
std::optional<std::int64_t> ns_from(std::string_view seconds) {
  const std::size_t point = std::min(seconds.find('.'), seconds.size());
  std::string digits(seconds.substr(0, point));
  std::string_view fraction = seconds.substr(std::min(point + 1, seconds.size()));
  digits.append(fraction.substr(0, 9));
  digits.append(9 - std::min<std::size_t>(fraction.size(), 9), '0');
  std::int64_t ns = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), ns);
  if (error != std::errc{} || end != digits.data() + digits.size()) return std::nullopt;
  return ns;
}

std::optional<std::int64_t> integer_from(std::string_view word) {
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc{} || end != word.data() + word.size()) return std::nullopt;
  return value;
}

std::vector<std::string> words_in(const std::string& line) {
  std::istringstream stream(line);
  std::vector<std::string> words;
  for (std::string word; stream >> word;) words.push_back(word);
  return words;
}

std::string times_path(const std::string& cube_path) {
  fs::path path(cube_path);
  if (path.extension() == ".fz") path.replace_extension();
  return path.replace_extension(".txt").string();
}

/// The columns of milk's text: index in the cube, index in all, s since the cube's start, log time,
/// acquisition time, cnt0, cnt1.
bool add_line(const std::string& line, MilkTimes& times) {
  const std::vector<std::string> words = words_in(line);
  if (words.size() < kColumns) return false;
  const auto logged = ns_from(words[3]);
  const auto acquired = ns_from(words[4]);
  const auto count = integer_from(words[5]);
  if (!integer_from(words[0]) || !logged || !acquired || !count) return false;
  times.sequence.push_back(*count);
  times.camera_ns.push_back(*acquired != 0 ? *acquired : *logged);
  times.received_ns.push_back(*logged);
  return true;
}

std::tm utc_of(std::int64_t ns) {
  const std::time_t seconds = ns / kNsPerS;
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  return utc;
}

std::string text_of(const char* format, std::int64_t ns) {
  std::array<char, 64> text{};
  const std::tm utc = utc_of(ns);
  std::strftime(text.data(), text.size(), format, &utc);
  return text.data();
}

template <typename... Values>
std::string printed(const char* format, Values... values) {
  std::array<char, 160> text{};
  std::snprintf(text.data(), text.size(), format, values...);
  return text.data();
}

std::string cube_name(std::string name, const std::string& time) {
  return name.append("_").append(time).append(".fits");
}

/// The times that milk has of a frame, in ns.
struct LoggedFrame {
  std::int64_t logged_ns;
  std::int64_t acquired_ns;  ///< 0: not known by UTC
  std::int64_t count;
};

LoggedFrame logged_frame(const FrameHeader& header) {
  const std::int64_t logged = header.received_ns != 0 ? header.received_ns : header.camera_ns;
  const bool same_clock = std::abs(header.camera_ns - logged) < kNsPerDay;
  return {logged, same_clock ? header.camera_ns : 0, header.sequence};
}

void write_times(const std::string& path, const std::vector<LoggedFrame>& frames) {
  std::ofstream file(path);
  file << "# Telemetry times, in s\n"
          "# index in cube, index, since start of cube, logged (UTC), acquired (UTC), cnt0, cnt1\n";
  const std::int64_t start = frames.front().logged_ns;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const LoggedFrame& frame = frames[i];
    const auto part = [](std::int64_t ns, std::int64_t unit) {
      return static_cast<long>(ns % kNsPerS / unit);
    };
    const std::int64_t us = (frame.acquired_ns + 500) / 1000 * 1000;
    file << printed(
        "%10ld %10lu %15.9f %10ld.%09ld %10ld.%06ld %10ld %10ld\n", static_cast<long>(i),
        static_cast<unsigned long>(i), 1e-9 * static_cast<double>(frame.logged_ns - start),
        static_cast<long>(frame.logged_ns / kNsPerS), part(frame.logged_ns, 1),
        static_cast<long>(us / kNsPerS), part(us, 1000), static_cast<long>(frame.count), 0L);
  }
  if (!file.flush()) throw Failure(path + " cannot be written; is the disk full?");
}

void write_keys(FitsFile& file, std::int64_t first_ns, std::int64_t last_ns) {
  constexpr double kUnixEpochMjd = 40587.0;
  const auto clock = [](std::int64_t ns) {
    return text_of("%H:%M:%S", ns) +
           printed(".%02ld", static_cast<long>(ns % kNsPerS / 10'000'000));
  };
  const auto mjd = [](std::int64_t ns) {
    return kUnixEpochMjd + static_cast<double>(ns) / static_cast<double>(kNsPerDay);
  };
  file.write_key("UT-STR", clock(first_ns), "UTC of the first frame");
  file.write_key("UT-END", clock(last_ns), "UTC of the last frame");
  file.write_key("MJD", 0.5 * (mjd(first_ns) + mjd(last_ns)), "of the middle");
  file.write_key("MJD-STR", mjd(first_ns), "of the first frame");
  file.write_key("MJD-END", mjd(last_ns), "of the last frame");
}

/// Writes the text beside the cube, and completes the cube. If that fails there is neither.
void complete(FitsFile& cube, const std::string& path, const std::vector<LoggedFrame>& frames) {
  const std::string times = times_path(path);
  try {
    write_times(times, frames);
    cube.commit();
  } catch (const Failure&) {
    std::error_code ignored;
    fs::remove(times, ignored);
    throw;
  }
}

void write_frame(FitsFile& file, std::int64_t number, const FrameBuffer& frame) {
  const FrameView view = frame.view();
  const std::size_t pixels = frame.format().pixels();
  const std::int64_t first = number * static_cast<std::int64_t>(pixels);
  if (view.pixel_type == PixelType::kU8)
    file.write_pixels<std::uint8_t>(first, {view.data<std::uint8_t>(), pixels});
  else
    file.write_pixels<std::uint16_t>(first, {view.data<std::uint16_t>(), pixels});
}

}  // namespace

std::optional<MilkTimes> read_milk_times(const std::string& cube_path) {
  const std::string path = times_path(cube_path);
  std::ifstream file(path);
  std::string line;
  if (!std::getline(file, line) || line.empty() || line[0] != '#') return std::nullopt;
  MilkTimes times;
  for (std::size_t number = 2; std::getline(file, line); ++number) {
    if (line.empty() || line[0] == '#') continue;
    if (add_line(line, times)) continue;
    if (times.sequence.empty()) return std::nullopt;  // It is another text.
    throw Failure(path + ":" + std::to_string(number) +
                  " is none of milk's lines of times; remove the file to read the cube without");
  }
  return times;
}

std::vector<std::string> fits_files_of(const std::string& path) {
  if (!fs::is_directory(path)) return {path};
  std::vector<std::string> found;
  for (const auto& entry : fs::recursive_directory_iterator(path)) {
    const std::string name = entry.path().filename().string();
    if (entry.is_regular_file() && (name.ends_with(".fits") || name.ends_with(".fits.fz")))
      found.push_back(entry.path().string());
  }
  if (found.empty()) throw Failure(path + " holds no FITS file; name a folder or file that does");
  std::sort(found.begin(), found.end());
  return found;
}

std::string write_milk_recording(const std::string& folder, const std::string& name,
                                 FrameSource& frames) {
  const FrameFormat& format = frames.format();
  if (format.scale_adu != 1.0 || format.zero_adu != 0.0)
    throw Failure(
        "milk's cubes hold counts, and these frames are ADU by a map; convert a recording");
  FrameBuffer frame(format);
  std::vector<LoggedFrame> logged;
  std::optional<FitsFile> file;
  std::string path;
  while (!stop_requested && frames.next(frame) == Delivery::kFrame) {
    logged.push_back(logged_frame(frame.header));
    if (!file) {
      const std::int64_t ns = logged.front().logged_ns;
      const fs::path day = fs::path(folder) / text_of("%Y%m%d", ns) / name;
      std::error_code error;
      fs::create_directories(day, error);
      if (error) throw Failure(day.string() + " cannot be made: " + error.message());
      const std::string time =
          text_of("%H:%M:%S", ns) + printed(".%09ld", static_cast<long>(ns % kNsPerS));
      path = (day / cube_name(name, time)).string();
      file = FitsFile::create(path);
      file->create_image(format.pixel_type == PixelType::kU8 ? ElementType::kU8 : ElementType::kU16,
                         {0, format.rows, format.cols});
    }
    write_frame(*file, static_cast<std::int64_t>(logged.size()) - 1, frame);
  }
  if (stop_requested) throw Failure("interrupted: " + folder + " has no new recording");
  if (!file) throw Failure("there is no frame to be written for milk");
  file->resize_planes(static_cast<std::int64_t>(logged.size()));
  write_keys(*file, logged.front().logged_ns, logged.back().logged_ns);
  complete(*file, path, logged);
  return path;
}

}  // namespace curlew
