#include "schema/store/hot_answers.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace tacho::store {

namespace {

/// The last hot row that this reader looks at. The table itself says, because rows may have moved since the head was
/// read; where it cannot, the head knows.
std::int64_t last_row(Connection& connection, const PartHead& head) {
  try {
    const std::int64_t last = connection.integer("SELECT ifnull(max(id), 0) FROM hot");
    return std::min(last, head.ends.row);
  } catch (const SqliteError& error) {
    if (!error.damaged()) {
      throw;
    }
    return head.ends.row;
  }
}

}  // namespace

void HotAnswers::BrokenRuns::bad(const AnswerMeta& meta) {
  Run& run = runs_[meta.source];
  if (run.count > 0 && run.session != meta.session) {
    tell(meta.source, run);
  }
  if (run.count == 0) {
    run = {meta.robot, meta.session, meta.seq, meta.seq, 0};
  }
  run.to = meta.seq;
  ++run.count;
}

void HotAnswers::BrokenRuns::finish() {
  for (auto& [source, run] : runs_) {
    tell(source, run);
  }
}

void HotAnswers::BrokenRuns::tell(Source source, Run& run) const {
  if (run.count > 0) {
    (*report_)(
        fmt::format("{} answers of robot {} source {} session {} (poll {} to {}) are damaged and left out; "
                    "reading goes on at the next keyframe",
                    run.count, run.robot, source_name(source), run.session, run.from, run.to));
    run.count = 0;
  }
}

HotAnswers::HotAnswers(Connection& connection, const PartHead& head, const AnswerQuery& query, StreamCounts& met,
                       const Report& report)
    : query_(&query),
      met_(&met),
      scan_(connection, head.vocabulary, last_row(connection, head),
            [&report](std::int64_t after, std::int64_t before, const std::string& why) {
              report(fmt::format("answers between rows {} and {} are lost: {}", after, before, why));
            }),
      chain_(connection, head.vocabulary),
      broken_(report) {
  advance();
}

const Answer& HotAnswers::take() {
  std::swap(answer_, next_);
  advance();
  return answer_;
}

void HotAnswers::advance() {
  row_ = 0;
  while (const HotRow* row = scan_.next()) {
    ++(*met_)[{row->meta.session, row->meta.robot, row->meta.source}].stored;
    if (!query_->asks_for(row->meta.session, row->meta.robot, row->meta.source) ||
        !query_->window.contains(row->meta.t_send_us)) {
      continue;
    }
    const std::string* body = chain_.body(*row);
    if (body == nullptr) {
      broken_.bad(row->meta);
      continue;
    }
    broken_.good(row->meta.source);
    next_.meta = row->meta;
    next_.body = *body;
    next_.header = row->header;
    row_ = row->id;
    return;
  }
  broken_.finish();
}

}  // namespace tacho::store
