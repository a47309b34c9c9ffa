# Read by ctest: one test for each suite of `program`, named after `folder`, with `labels`. The longest
# come first: those that run the program. Where it is not built, running it fails.
if(NOT EXISTS "${program}")
  add_test("${folder}.NotBuilt" "${program}")
  set_tests_properties("${folder}.NotBuilt" PROPERTIES LABELS "${labels}")
  return()
endif()
execute_process(COMMAND "${program}" --gtest_list_tests OUTPUT_VARIABLE list RESULT_VARIABLE failed)
if(failed)
  message(FATAL_ERROR "${program} does not list its tests")
endif()
# Suites stand at the beginning of a line and end with a full stop.
string(REGEX MATCHALL "(^|\n)[^ \n]+\\.(\n|  #)" suites "${list}")
set(cost 0)
if(labels MATCHES program)
  set(cost 1000)
endif()
foreach(suite IN LISTS suites)
  string(REGEX REPLACE "[\n# ]|\\.[\n# ]*$" "" suite "${suite}")
  add_test("${folder}.${suite}" "${program}" "--gtest_filter=${suite}.*")
  set_tests_properties("${folder}.${suite}" PROPERTIES LABELS "${labels}" TIMEOUT 1200
    COST ${cost})
endforeach()
