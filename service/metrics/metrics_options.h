// MetricsOptions say where Prometheus finds the daemon's figures.
#pragma once

#include <string>

namespace curlew {

/// Section [metrics].
struct MetricsOptions {
  std::string listen;            ///< ADDRESS:PORT, as "127.0.0.1:9464"; empty: nobody is served
  bool beyond_loopback = false;  ///< whether other machines may ask
};

}  // namespace curlew
