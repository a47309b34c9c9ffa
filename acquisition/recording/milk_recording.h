// Recordings as milk's loggers make them: FITS cubes, each with a text file of times beside it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "acquisition/frame_source.h"

namespace curlew {

/// Holds what the text file says of each frame of a cube.
struct MilkTimes {
  std::vector<std::int64_t> sequence;     ///< the stream's counter, cnt0
  std::vector<std::int64_t> camera_ns;    ///< acquisition, else the time of logging; UTC since 1970
  std::vector<std::int64_t> received_ns;  ///< when the frame was logged, UTC since 1970
};

/// Reads NAME.txt beside NAME.fits (or NAME.fits.fz). Returns nullopt if there is none, or if it is
/// some other text: milk's begins with '#' and has seven columns. Throws Failure, which names file
/// and line, if a line of milk's text cannot be read.
std::optional<MilkTimes> read_milk_times(const std::string& cube_path);

/// Returns the FITS files in a folder and in those below, in the order of their paths; a file's own
/// path if it is none. Throws Failure for a folder without any.
std::vector<std::string> fits_files_of(const std::string& path);

/// Writes the frames as milk's loggers do: FOLDER/YYYYMMDD/NAME/NAME_HH:MM:SS.nnnnnnnnn.fits, by
/// the UTC of the first frame, and the text beside it. Column "acquisition" is CAMERA_NS where that
/// is within a day of the time of receipt, and else 0, because other clocks of cameras are not UTC.
/// Returns the path of the cube. Throws Failure, also where the program shall end meanwhile; there
/// is then no file.
std::string write_milk_recording(const std::string& folder, const std::string& name,
                                 FrameSource& frames);

}  // namespace curlew
