#include "acquisition/recording/recording_keys.h"

#include <cmath>
#include <cstdint>
#include <limits>
#include <string>

#include "core/error.h"

namespace curlew {
namespace {

/// Reads a quantity that makes sense only from `minimum` to `maximum`. Throws Failure if it lies
/// outside.
void read(FitsFile& file, const std::string& name, double& into, double minimum, double maximum) {
  const auto value = file.key_double(name);
  if (!value) return;
  if (!(*value >= minimum && *value <= maximum)) {
    throw Failure(file.path() + " has a key " + name +
                  " that makes no sense: " + std::to_string(*value));
  }
  into = *value;
}

constexpr double kMinLength_m = 1e-9;
constexpr double kMaxLength_m = 1e3;

void read(FitsFile& file, const std::string& name, int& into) {
  const std::int64_t value = file.key_int(name).value_or(into);
  if (value < std::numeric_limits<int>::min() || value > std::numeric_limits<int>::max()) {
    throw Failure(file.path() + " has a key " + name + " out of range: " + std::to_string(value));
  }
  into = static_cast<int>(value);
}

void write(FitsFile& file, const std::string& name, double value, const std::string& comment,
           const std::string& unit) {
  if (!std::isnan(value)) file.write_key(name, value, comment, unit);
}

}  // namespace

void read_optics(FitsFile& file, Optics& optics) {
  read(file, "PITCH_M", optics.pitch_m, kMinLength_m, kMaxLength_m);
  read(file, "FOCAL_M", optics.focal_m, kMinLength_m, kMaxLength_m);
  read(file, "PIXEL_M", optics.pixel_m, kMinLength_m, kMaxLength_m);
  read(file, "WAVELEN", optics.wavelength_m, kMinLength_m, kMaxLength_m);
  read(file, "MAGNIF", optics.magnification, 1e-6, 1e6);
  int parity = optics.mirrored ? -1 : 1;
  read(file, "PARITY", parity);
  if (parity != 1 && parity != -1) {
    throw Failure(file.path() +
                  " has a key PARITY that is neither 1 nor -1: " + std::to_string(parity));
  }
  optics.mirrored = parity == -1;
}

void read_detector(FitsFile& file, Detector& detector) {
  read(file, "EPERADU", detector.e_per_adu, 1e-9, 1e9);
  read(file, "RDNOISE", detector.read_noise_e, 0.0, 1e9);
  read(file, "SATURATE", detector.saturation_adu, -1e12, 1e12);
  read(file, "BITDEPTH", detector.bit_depth);
}

void read_region(FitsFile& file, FrameFormat& format) {
  read(file, "OFFSETX", format.offset_x_px);
  read(file, "OFFSETY", format.offset_y_px);
  read(file, "XBINNING", format.binning);
  if (format.binning < 1) throw Failure(file.path() + " has a key XBINNING below 1");
  int binning_y = format.binning;
  read(file, "YBINNING", binning_y);
  if (binning_y != format.binning) {
    throw Failure(file.path() + " is binned " + std::to_string(format.binning) + " x " +
                  std::to_string(binning_y) + " (keys XBINNING, YBINNING), pixels must be square");
  }
}

void write_optics(FitsFile& file, const Optics& optics) {
  write(file, "PITCH_M", optics.pitch_m, "lenslet pitch", "m");
  write(file, "FOCAL_M", optics.focal_m, "lenslet focal length", "m");
  write(file, "PIXEL_M", optics.pixel_m, "detector pixel, as binned", "m");
  write(file, "WAVELEN", optics.wavelength_m, "wavelength", "m");
  write(file, "MAGNIF", optics.magnification, "relay between lenslets and detector", "");
  file.write_key("PARITY", std::int64_t{optics.mirrored ? -1 : 1}, "-1: mirrored relay");
}

void write_detector(FitsFile& file, const Detector& detector) {
  write(file, "EPERADU", detector.e_per_adu, "electrons per ADU", "electron/adu");
  write(file, "RDNOISE", detector.read_noise_e, "read noise", "electron");
  write(file, "SATURATE", detector.saturation_adu, "saturated at or above", "adu");
  if (detector.bit_depth > 0) {
    file.write_key("BITDEPTH", std::int64_t{detector.bit_depth}, "bits of the converter");
  }
}

void write_region(FitsFile& file, const FrameFormat& format) {
  file.write_key("OFFSETX", std::int64_t{format.offset_x_px}, "first column on the detector",
                 "pix");
  file.write_key("OFFSETY", std::int64_t{format.offset_y_px}, "first row on the detector", "pix");
  file.write_key("XBINNING", std::int64_t{format.binning}, "detector pixels a pixel, along x");
  file.write_key("YBINNING", std::int64_t{format.binning}, "detector pixels a pixel, along y");
}

}  // namespace curlew
