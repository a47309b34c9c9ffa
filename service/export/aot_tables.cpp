#include "service/export/aot_tables.h"

namespace curlew {
namespace {

constexpr auto kText = RecordKind::kText;
constexpr auto kInteger = RecordKind::kInteger;
constexpr auto kReal = RecordKind::kReal;
constexpr auto kList = RecordKind::kList;

struct AotColumn {
  const char* name;
  RecordKind kind;
  const char* unit = "";
};

const std::map<std::string, std::vector<AotColumn>>& aot_columns() {
  static const std::map<std::string, std::vector<AotColumn>> columns = {
      {"AOT_TIME", {{"UID", kText}, {"TIMESTAMPS", kList, "s"}, {"FRAME_NUMBERS", kList, "count"}}},
      {"AOT_ATMOSPHERIC_PARAMETERS",
       {{"UID", kText},
        {"WAVELENGTH", kReal, "m"},
        {"TIME_UID", kText},
        {"R0", kList, "m"},
        {"SEEING", kList, "arcsec"},
        {"TAU0", kList, "s"},
        {"THETA0", kList, "rad"},
        {"LAYERS_REL_WEIGHT", kText},
        {"LAYERS_HEIGHT", kText},
        {"LAYERS_LO", kText},
        {"LAYERS_WIND_SPEED", kText},
        {"LAYERS_WIND_DIRECTION", kText},
        {"TRANSFORMATION_MATRIX", kText}}},
      {"AOT_ABERRATIONS",
       {{"UID", kText},
        {"MODES", kText},
        {"COEFFICIENTS", kText},
        {"X_OFFSETS", kList, "rad"},
        {"Y_OFFSETS", kList, "rad"}}},
      {"AOT_TELESCOPES",
       {{"UID", kText},
        {"TYPE", kText},
        {"LATITUDE", kReal, "deg"},
        {"LONGITUDE", kReal, "deg"},
        {"ELEVATION", kReal, "deg"},
        {"AZIMUTH", kReal, "deg"},
        {"PARALLACTIC", kReal, "deg"},
        {"PUPIL_MASK", kText},
        {"PUPIL_ANGLE", kReal, "rad"},
        {"ENCLOSING_D", kReal, "m"},
        {"INSCRIBED_D", kReal, "m"},
        {"OBSTRUCTION_D", kReal, "m"},
        {"SEGMENT_TYPE", kText},
        {"SEGMENT_SIZE", kReal, "m"},
        {"SEGMENTS_X", kList, "m"},
        {"SEGMENTS_Y", kList, "m"},
        {"TRANSFORMATION_MATRIX", kText},
        {"ABERRATION_UID", kText}}},
      {"AOT_SOURCES",
       {{"UID", kText},
        {"TYPE", kText},
        {"RIGHT_ASCENSION", kReal, "deg"},
        {"DECLINATION", kReal, "deg"},
        {"ELEVATION_OFFSET", kReal, "deg"},
        {"AZIMUTH_OFFSET", kReal, "deg"},
        {"FWHM", kReal, "rad"}}},
      {"AOT_DETECTORS",
       {{"UID", kText},
        {"TYPE", kText},
        {"SAMPLING_TECHNIQUE", kText},
        {"SHUTTER_TYPE", kText},
        {"FLAT_FIELD", kText},
        {"READOUT_NOISE", kReal, "electron*s^-1*pix^-1"},
        {"PIXEL_INTENSITIES", kText},
        {"FIELD_CENTRE_X", kReal, "pix"},
        {"FIELD_CENTRE_Y", kReal, "pix"},
        {"INTEGRATION_TIME", kReal, "s"},
        {"COADDS", kInteger, "count"},
        {"DARK", kText},
        {"WEIGHT_MAP", kText},
        {"QUANTUM_EFFICIENCY", kReal},
        {"PIXEL_SCALE", kReal, "rad*pix^-1"},
        {"BINNING", kInteger, "count"},
        {"BANDWIDTH", kReal, "m"},
        {"TRANSMISSION_WAVELENGTH", kList, "m"},
        {"TRANSMISSION", kList},
        {"SKY_BACKGROUND", kText},
        {"GAIN", kReal, "electron"},
        {"EXCESS_NOISE", kReal, "electron"},
        {"FILTER", kText},
        {"BAD_PIXEL_MAP", kText},
        {"DYNAMIC_RANGE", kReal, "dB"},
        {"READOUT_RATE", kReal, "pix*s^-1"},
        {"FRAME_RATE", kReal, "frame*s^-1"},
        {"TRANSFORMATION_MATRIX", kText}}},
      {"AOT_SCORING_CAMERAS",
       {{"UID", kText},
        {"PUPIL_MASK", kText},
        {"WAVELENGTH", kReal, "m"},
        {"TRANSFORMATION_MATRIX", kText},
        {"DETECTOR_UID", kText},
        {"ABERRATION_UID", kText}}},
      {"AOT_WAVEFRONT_SENSORS",
       {{"UID", kText},
        {"TYPE", kText},
        {"SOURCE_UID", kText},
        {"DIMENSIONS", kInteger, "count"},
        {"N_VALID_SUBAPERTURES", kInteger, "count"},
        {"MEASUREMENTS", kText},
        {"REF_MEASUREMENTS", kText},
        {"SUBAPERTURE_MASK", kText},
        {"MASK_X_OFFSETS", kList, "pix"},
        {"MASK_Y_OFFSETS", kList, "pix"},
        {"SUBAPERTURE_SIZE", kReal, "pix"},
        {"SUBAPERTURE_INTENSITIES", kText},
        {"WAVELENGTH", kReal, "m"},
        {"OPTICAL_GAIN", kText},
        {"TRANSFORMATION_MATRIX", kText},
        {"DETECTOR_UID", kText},
        {"ABERRATION_UID", kText},
        {"NCPA_UID", kText}}},
      {"AOT_WAVEFRONT_SENSORS_SHACK_HARTMANN",
       {{"UID", kText},
        {"CENTROIDING_ALGORITHM", kText},
        {"CENTROID_GAINS", kText},
        {"SPOT_FWHM", kText}}},
      {"AOT_WAVEFRONT_CORRECTORS",
       {{"UID", kText},
        {"TYPE", kText},
        {"TELESCOPE_UID", kText},
        {"N_VALID_ACTUATORS", kInteger, "count"},
        {"PUPIL_MASK", kText},
        {"TFZ_NUM", kList},
        {"TFZ_DEN", kList},
        {"TRANSFORMATION_MATRIX", kText},
        {"ABERRATION_UID", kText}}},
      {"AOT_LOOPS",
       {{"UID", kText},
        {"TYPE", kText},
        {"COMMANDED_UID", kText},
        {"TIME_UID", kText},
        {"STATUS", kText},
        {"COMMANDS", kText},
        {"REF_COMMANDS", kText},
        {"FRAMERATE", kReal, "Hz"},
        {"DELAY", kReal, "frame"},
        {"TIME_FILTER_NUM", kText},
        {"TIME_FILTER_DEN", kText}}}};
  return columns;
}

}  // namespace

void write_aot_table(FitsFile& file, const std::string& name, const AotRow& row) {
  std::vector<RecordField> fields;
  for (const AotColumn& column : aot_columns().at(name)) {
    const auto cell = row.find(column.name);
    fields.push_back({column.name, column.kind, column.unit,
                      cell != row.end() ? cell->second : decltype(RecordField::value){}});
  }
  file.create_record(name, fields, !row.empty());
}

std::string image_reference(const std::string& name) { return "INTREF<" + name + ">"; }
std::string row_reference(const std::string& uid) { return "ROWREF<" + uid + ">"; }

}  // namespace curlew
