// ShownFrames: what `replay --page` and `replay --report` show of the frames.
#pragma once

#include <memory>
#include <string>

#include "service/page/frame_store.h"
#include "service/page/page_server.h"
#include "service/stages.h"

namespace curlew {

/// Where frames are shown; both empty: nowhere.
struct ShownFramesOptions {
  std::string page;    ///< address and port where the page is served
  std::string report;  ///< HTML file
  bool wanted() const { return !page.empty() || !report.empty(); }
};

/// The frames that page and report show, and the server of the page, where the user asked for them.
class ShownFrames {
 public:
  /// Serves the page from now on. Throws Failure if the address cannot be had.
  ShownFrames(ShownFramesOptions options, const std::string& recording,
              std::shared_ptr<const Plan> plan);

  FrameStore* store() const { return store_.get(); }  ///< null if nothing is shown
  /// There are no more frames; writes the report.
  void finish() const;
  /// Shows the frames until the user ends the program.
  void wait() const;

 private:
  ShownFramesOptions options_;
  std::unique_ptr<FrameStore> store_;
  std::unique_ptr<PageServer> server_;  ///< the last, because it uses the store
};

}  // namespace curlew
