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
    Statement last(connection, "SELECT ifnull(max(id), 0) FROM hot WHERE id <= ?1");
    last.query(head.ends.row);
    return last.step() ? last.integer(0) : 0;
  } catch (const SqliteError& error) {
    if (!error.damaged()) {
      throw;
    }
    return head.ends.row;
  }
}

}  // namespace

void HotAnswers::BrokenRuns::bad(const HotRow& row, Source source, std::uint64_t seq) {
  Run& run = runs_[source];
  if (run.count > 0 && run.session != row.session) {
    tell(source, run);
  }
  if (run.count == 0) {
    run = {row.robot, row.session, seq, seq, 0};
  }
  run.to = seq;
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
      vocabulary_(&head.vocabulary),
      scan_(connection, head.vocabulary, last_row(connection, head),
            [&report](std::int64_t after, std::int64_t before, const std::string& why) {
              report(fmt::format("answers between rows {} and {} are lost: {}", after, before, why));
            }),
      chain_(connection),
      broken_(report),
      unread_(scan_.next()) {
  advance();
}

const Answer& HotAnswers::take() {
  answer_.meta = next_->meta;
  next_->batch.fill(next_->mark(), answer_);
  ++next_->next;
  skip_outside(*next_);
  advance();
  return answer_;
}

void HotAnswers::skip_outside(Open& open) const {
  while (!open.done() && !query_->window.contains(open.mark().t_send_us)) {
    ++open.next;
  }
}

/// Reads rows until the next answer is known.
void HotAnswers::advance() {
  for (;;) {
    next_ = nullptr;
    for (Open& open : open_) {
      if (!open.done() && (next_ == nullptr || open.mark().place < next_->mark().place)) {
        next_ = &open;
      }
    }
    if (unread_ == nullptr || (next_ != nullptr && next_->mark().place < unread_->id)) {
      break;
    }
    const Source source = *source_of(*unread_, *vocabulary_);
    (*met_)[{unread_->session, unread_->robot, source}].stored += unread_->rows;
    if (query_->asks_for(unread_->session, unread_->robot, source)) {
      open(*unread_, source);
    }
    unread_ = scan_.next();
  }
  if (next_ == nullptr) {
    broken_.finish();
  }
}

void HotAnswers::open(const HotRow& row, Source source) {
  auto place = std::find_if(open_.begin(), open_.end(), [](const Open& open) { return open.done(); });
  if (place == open_.end()) {
    place = open_.insert(open_.end(), Open{});
  }
  Open& open = *place;
  open.meta = {row.robot, source, row.session, 0, 0, 0};
  open.next = 0;
  const bool readable = read_marks(row, open.batch.marks).has_value();
  skip_outside(open);
  if (readable && open.done()) {
    return;  // its bodies need not be decompressed
  }
  if (chain_.open(row, open.batch)) {
    broken_.good(source);
    return;
  }
  for (const HotMark& mark : open.batch.marks) {
    if (query_->window.contains(mark.t_send_us)) {
      broken_.bad(row, source, mark.seq);
    }
  }
  if (!readable) {
    broken_.bad(row, source, row.seq);
  }
  open.batch.clear();
  open.next = 0;
}

}  // namespace tacho::store
