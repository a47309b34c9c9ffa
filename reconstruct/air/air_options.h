// What the user says of the air, and for how long it is looked at.
#pragma once

namespace curlew {

struct AirOptions {
  /// The figures of the air are those of so many seconds, and then of the next; 0: none are made.
  double window_s = 0.0;
  /// √(λL) in pitches of a path of length L through even air, as projected onto the lenslets; with
  /// it diffraction on the way is reckoned with. 0: the air is near, or √(λL) below a pitch.
  double fresnel_pitches = 0.0;
};

}  // namespace curlew
