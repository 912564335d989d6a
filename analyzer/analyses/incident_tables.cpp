#include "analyzer/analyses/incident_tables.hpp"

namespace tacho {

DataTable timeline_table() {
  DataTable table;
  table.name = "timeline";
  table.title = "Time line";
  table.columns = {{"t", "", "when it was seen; for a gap, when it began", false, true},
                   {"offset_s", "s", "seconds after the moment asked for"},
                   {"robot", "", "robot"},
                   {"kind", "", "event, alarm, gap, change, or the moment asked for"},
                   {"source", "", "sources it was seen in, the first to see it first"},
                   {"what", "", "event, alarm code, gap cause, or field"},
                   {"old", "", "value before"},
                   {"new", "", "value after"},
                   {"detail", "", "alarm text, words of the system; how much later other sources saw it"},
                   {"hull_from", "", "it happened after this time", false, true},
                   {"hull_to", "", "and not later than this one", false, true}};
  return table;
}

DataTable signals_table() {
  return {"signals",
          "Signals that changed, the most striking first",
          {{"robot", "", "robot"},
           {"field", "", "field; angles are unwrapped"},
           {"unit", "", "unit of the five values"},
           {"source", "", "source with the most answers in the window"},
           number_column("first", "first value in the window"),
           number_column("min", "least value"),
           number_column("max", "greatest value"),
           number_column("last", "last value in the window"),
           number_column("largest_step", "largest change between two answers"),
           {"step_from", "", "answer before the largest change", false, true},
           {"step_to", "", "answer after it", false, true},
           number_column("material_step", "change that counts, in its unit: setting incident.step_*"),
           {"set_by", "", "where material_step comes from"},
           {"materiality", "1", "range over material_step"}},
          {},
          false};
}

DataTable state_table() {
  return {"state",
          "State at the moment asked for",
          {{"robot", "", "robot"},
           {"field", "", "field, or alarm"},
           {"value", "", "last value before the moment"},
           {"unit", "", "unit of the value"},
           {"state", "", "present, null, not_meaningful, not_supplied or wrong_type"},
           {"source", "", "source of the value"},
           {"age_s", "s", "how old the value was"}},
          {},
          false};
}

DataTable quality_table() {
  return {"quality",
          "Data quality in the window",
          {{"robot", "", "robot"},
           {"source", "", "source"},
           {"period_s", "s", "planned period"},
           integer_column("stored", "answers"),
           number_column("missed",
                         "planned polls without an answer; gaps that reach beyond the window count in proportion"),
           integer_column("partial", "answers of which some registers are missing"),
           {"causes", "", "causes of gaps"},
           {"longest_hole_s", "s", "longest time between two polls"},
           {"worst_round_trip_s", "s", "longest time from request to answer"},
           {"clock_offset", "s", "robot clock minus host clock, nearest to the moment"}},
          {},
          false};
}

}  // namespace tacho
